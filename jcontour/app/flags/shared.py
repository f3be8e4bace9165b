"""Flags that several commands have."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from jcontour.app.plain_numbers import Samples

Terminal = Literal["output", "riccati"]
Planner = Literal["jcontour", "linuxcnc", "grbl"]
FeedLaw = Literal["trapezoidal", "jerk"]
DrawingUnit = Literal["mm", "cm", "m", "inch", "px", "pt"]
Objective = Literal["typical", "worst", "mean"]
Rollouts = Literal["auto", "full", "thinned", "none"]

ROLLOUTS: Rollouts = "auto"  # all that fits into 100 MB
HORIZON = 10  # samples: the paper's usual horizon
HORIZON_TIME = 5e-3  # [s] that it is long there, at 2 kHz


@dataclass(frozen=True)
class Common:
    """Flags that every command understands."""

    json: bool = False  # a person reads it
    """Print the result as JSON on stdout, and nothing else there."""
    details: bool = False  # fifteen lines are read
    """Print every table before the screen that sums them up."""


@dataclass(frozen=True)
class MakesRun(Common):
    """A command that makes a run folder."""

    out: Path | None = None
    """Run folder; runs/<command>-<time> when not given. It must not hold another run."""


@dataclass(frozen=True)
class RunsCode(Common):
    """A command that may run a Python file of the user's from a run folder."""

    trust_code: bool = False  # a run folder may be somebody else's
    """Run the Python files that lie in the run folder named here, now and later.
    A file that a command of yours has named needs no flag."""


@dataclass(frozen=True)
class MachineFlags(RunsCode):
    """Machine and pace."""

    plant: str = "bridgeport"  # the machine of McNab & Tsao's paper
    """Machine: a name from `jcontour list`, or a JSON file.
    `jcontour machine --example FILE` writes one. Or FILE.py:NAME: a plant, or what makes one."""
    feed_mm_per_min: float | None = None
    """Feed [mm/min] instead of the programmed one; 3000 where nothing is programmed."""
    acceleration: float | None = None
    """Path acceleration of the rest-to-rest feed law [m/s^2].
    When not given, half of what the machine states, or 2: its tool takes more than it is asked
    for."""
    feed_law: FeedLaw = "jerk"  # asks nothing of a machine that it cannot do
    """Law of toolpath files. jerk: the quickest motion under limits of speed, acceleration and jerk
    on every axis, with curves through short moves and blended corners. trapezoidal: neither, and
    no limit on the jerk; in corners the speed of an axis jumps, which asks for more acceleration
    than the limit."""
    jerk: float | None = None
    """Jerk limit of every axis [m/s^3], for --feed-law jerk.
    When not given, that of the machine; without one the acceleration builds up in 20 ms."""
    machine_limits: str | None = None
    """Speeds, accelerations and corner settings of a control, in full: LinuxCNC's INI or
    grbl's `$$` listing. When not given, those of the machine."""
    planner: Planner = "jcontour"  # the others have no limit on the jerk
    """Control whose motion and cycle time are predicted for toolpath files."""
    junction_deviation_um: float | None = None
    """Junction deviation of grbl [um], for --planner grbl; 10 or that of --machine-limits."""
    drawing_unit: DrawingUnit | None = None
    """Unit of a drawing, whatever its file says. When not given, the file has to say.
    px: 1/96 inch, as browsers and Inkscape have it, 1/90 in Inkscape before 0.92.
    pt: 1/72 inch, as Illustrator has it."""
    join_um: float = 10.0  # programs that draw snap to less
    """Distance [um] within which ends of a drawing's lines and curves are joined."""
    tool_table: str | None = None
    """Tool table of LinuxCNC [mm], for programs with cutter compensation (G41, G42) or G43."""
    corner_tolerance_um: float = 2.0  # takes 2 % longer than 5, and leaves the error to the loop
    """Distance [um] from the part within which curves run through short moves and corners are
    blended, as far as the feed needs it; 0 stops in them. For --feed-law jerk."""


@dataclass(frozen=True)
class Controlled(MachineFlags):
    """The controller and its first weights."""

    controller: str | None = None
    """A name from `jcontour list`, or FILE.py:NAME: a class of yours that needs no arguments, or a
    function that takes the machine's model. The usual one of the machine when not given."""
    weights: tuple[str, ...] = ()
    """First weights by name, each as NAME=VALUE, instead of the controller's own.
    NAME=VALUE,VALUE,... where a weight has a number for each axis."""
    backlash: bool = False  # most machines state none
    """Compensate the backlash of the machine file: the motors lead by half of it."""
    preview: Samples | None = None
    """Horizon of an LQ controller [samples]; not tuned here, see `jcontour sweep`.
    When not given 10, and as many as 5 ms have where a machine is sampled faster.
    path: all samples of the run, with `simulate`, `precompensate` and `learn`."""
    terminal: Terminal = "output"  # the paper's better performing choice
    """Cost at the end of an LQ controller's horizon: output error, or the Riccati solution.
    The Riccati solution is stable on straight lines."""
    alpha: float | None = None
    """LQ: start weight on the tracking error [1/m^2].
    When not given: the published one of the machine, else one that suits its bandwidth."""
    beta: float | None = None
    """LQ: start weight on the contour error [1/m^2]; likewise."""
    rho: float | None = None
    """LQ: weight on the control [1/control unit^2]; likewise.
    Fixed, because only alpha/rho and beta/rho matter."""
    model_delay: int | None = None
    """LQ: samples of the machine's unknown delay that the model predicts over.
    Tuning takes the middle of what the machine may have when not given."""

    def horizon(self, dt: float) -> int:
        """Samples of the future that are asked for, of machines with this sample period [s]."""
        usual = max(HORIZON, round(HORIZON_TIME / dt))
        return usual if self.preview is None else self.preview


@dataclass(frozen=True)
class Limited(Controlled):
    """Limits on the controller that is found, for every contour and every plant of the family."""

    RARE: ClassVar[tuple[str, ...]] = (  # flags that few runs need: help tells of them when asked
        *("trust_code", "feed_law", "jerk", "drawing_unit", "join_um", "terminal", "rho"),
        *("tool_table", "machine_limits", "planner", "junction_deviation_um"),
        "model_delay",
        "backlash",
        *("min_delay_margin", "max_count_noise", "max_peak_tracking_error_um", "max_rms_control"),
        *("max_peak_contour_error_um", "max_peak_control", "max_rms_increment"),
        *("max_peak_increment", "seed", "devices", "nominal_only"),
    )

    max_sensitivity: float | None = 2.0  # 6 dB, the usual bound on the peak sensitivity
    """Limit on the peak sensitivity Ms of the loops along the path; None for no limit.
    1.4 is very robust, 2 usual, 3 the most that should run a machine."""
    min_delay_margin: int = 0  # the family has the machine's unknown delay already
    """Samples of delay beyond its own that every loop of every plant of the family has to bear."""
    max_count_noise: float | None = 0.01  # a calm control; more of it buys parts of a count
    """Limit on the RMS control that the rounding of encoders to counts causes, as a part of the
    machine's control limit; None for no limit."""
    max_tracking_error_um: float | None = None
    """Limit on the RMS tracking error [um]."""
    max_peak_tracking_error_um: float | None = None
    """Limit on the peak tracking error [um]."""
    max_peak_contour_error_um: float | None = None
    """Limit on the peak contour error [um]."""
    max_rms_control: float | None = None
    """Limit on the RMS of the control vector [control unit]."""
    max_peak_control: float | None = None
    """Limit on the peak of the control vector over the scored samples [control unit].
    Limits of the machine hold at every sample."""
    max_rms_increment: float | None = None
    """Limit on the RMS of the control increment vector [control unit per sample]."""
    max_peak_increment: float | None = None
    """Limit on the peak of its increment over the scored samples [control unit per sample]."""


@dataclass(frozen=True)
class Storage(Limited, MakesRun):
    """Run folder, random seed and devices; a run may go on elsewhere than it began."""

    seed: int = 0  # any number: the same one repeats the run
    """Seed of everything random: the points looked at before descending."""
    resume: Path | None = None
    """Go on with the run in this folder; its own settings hold."""
    devices: str = "1"  # so that a run ends in the same digits on every computer
    """Devices that contours are spread over: `all`, or a number.
    Devices are GPUs, or else cores of the CPU; one alone is the CPU, which compiles sooner."""


@dataclass(frozen=True)
class Aimed(Storage):
    """What is made small, on which plants, by which weights."""

    objective: Objective = "typical"  # a per cent of any contour counts alike
    """Objective, of RMS contour errors; on a machine of one axis, of tracking errors.
    typical: the geometric mean over contours of the family's worst.
    worst: the largest error of all. mean: the mean over contours and plants."""
    max_effort: float | None = None
    """Limit on the RMS of the control vector as a multiple of what the start weights need.
    1.2 on flexible axes and gantries when neither this nor --max-rms-control is given."""
    nominal_only: bool = False  # the machine is not known better than its family
    """Tune on the nominal plant alone instead of its family; the family is still in the tables.
    Where another plant of the family exceeds a limit, the values are not for use."""
    free: str | None = None
    """Weights to tune, by name with commas, as alpha,beta,observer; the others stay.
    Those that give the best answer in a minute when not given. LQ: observer stands for its noises,
    stage for one weight more for every sample of the horizon."""
