"""Flags of the commands that run one loop, given by names or by a stored run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from jcontour.app.flags.shared import ROLLOUTS, Controlled, MakesRun, Rollouts, RunsCode

Fallback = Literal["stop", "hold", "soft"]

FALLBACK: Fallback = "stop"  # no number comes from a step that was not solved
SOLVER = "daqp"  # exact to rounding and the fastest


@dataclass(frozen=True)
class Simulate(Controlled, MakesRun):
    """Simulate one controller on one contour: table, figures, netCDF.

    With --controller mpcc or tracking-mpc a quadratic program is solved at every sample, on the
    nominal machine, whose whole state is measured: --preview is the horizon, --feed-mm-per-min the
    (highest) speed along the path.
    """

    contour: Positional[str | None] = None
    """A name from `jcontour list`, or a toolpath file (.ngc, .dxf, .svg, .csv).
    The machine's usual contour when not given."""
    rollouts: Rollouts = ROLLOUTS
    """Samples kept in rollouts.nc: all, some, or no file; `auto` thins what is large.
    Figures are drawn from all."""
    list_moves: bool = False  # a long program fills the screen
    """Print the moves of a program or a drawing as they were understood, and simulate nothing."""


@dataclass(frozen=True)
class Precompensate(Controlled, MakesRun):
    """Bend the reference of a part beforehand, so that the tool of the whole family runs on it.

    The controller stays as it is: its drive runs the bent reference, as samples or as G-code. The
    bend is for its gains, which are printed.
    """

    controller: str | None = "cascade"  # what a drive has whose control cannot be changed
    """A name from `jcontour list`, or FILE.py:NAME: a class of yours that needs no arguments, or a
    function that takes the machine's model. The P-PI cascade follows with a lag, which the bent
    reference takes off. A controller that sees the path ahead, as contouring-lq, gains little."""
    part: Positional[str | None] = None
    """A toolpath (.ngc, .dxf, .svg, .csv), a name from `jcontour list`, or a run folder of
    `jcontour tune` or `simulate`: its first part, with its machine, controller and weights.
    The machine's usual contour when not given."""
    roughness: float = 0.01  # the least with which no run of ours shook an axis
    """Price of the bends of the correction. More is smoother and follows less.
    It is raised tenfold while a limit of the machine is exceeded."""


@dataclass(frozen=True)
class Learn(Controlled, MakesRun):
    """Learn a part lap by lap: error per lap, with encoder noise and parameter error.

    The law is norm-optimal: it knows the model and the direction of the path.
    Before the first lap it is said whether the laps converge, by linear models of the family.
    """

    contour: Positional[str | None] = None
    """A name from `jcontour list`, or a toolpath file (.ngc, .dxf, .svg, .csv).
    The machine's usual contour when not given."""
    laps: int = 20  # most learn in five
    """Laps of the whole run; each one starts alike."""
    effort: float = 0.1  # nine tenths of a slow contour error are learned in a lap
    """Price of a change of the correction; more is slower, and averages noise."""
    smoothing: int | None = None
    """How often the filter (1/4, 1/2, 1/4) is passed over the correction.
    When not given, as often as the bound over the family needs."""
    seed: int = 0  # any number: the same one repeats the run
    """Seed of the encoder noise."""


@dataclass(frozen=True)
class Check(RunsCode, MakesRun):
    """Check a stored run: under the machine's limits, by a proof (--bound), or in a real control.

    Limits: a tuned run goes through constrained MPC with the same weights; the tables say where
    limits act, and what they cost. --bound: the largest contour error of the loop under bounded
    disturbances, with the error that an attack within the bounds reaches. --in-linuxcnc: contour
    error and cycle time of that control, beside those of `simulate`.
    """

    run: Positional[Path] = Path()
    """Run folder of `jcontour tune`; else of `simulate` too, of a linear machine."""
    bound: bool = False  # it takes a linear machine
    """Prove the largest contour error instead of keeping the limits."""
    in_linuxcnc: bool = False  # it has to be installed
    """Run the programs in LinuxCNC, the law and the machine as its components."""
    max_control: float | None = None
    """Limit on every control [control unit]; the machine's own when not given."""
    max_increment: float | None = None
    """Limit on the change of every control per sample [control unit].
    The machine's own when not given."""
    max_speed_mm_per_min: float | None = None
    """Limit on the speed of every axis [mm/min]; the machine's own when not given."""
    max_acceleration: float | None = None
    """Limit on the acceleration of every axis [m/s^2]; the machine's own when not given."""
    fallback: Fallback = FALLBACK
    """Action at a step whose QP has no answer.
    Stop the run, hold the last control, or soften the limits."""
    solver: str = SOLVER
    """QP solver: daqp, proxqp, or any that qpsolvers finds installed."""
    force: float | None = None
    """--bound: largest disturbance on every control at every sample: friction, cutting
    [control unit]. When not given, the friction or, where it is more, the control noise of the
    machine file."""
    encoder_um: float | None = None
    """--bound: largest error of every measured position [um]; half a count of each when not
    given."""


@dataclass(frozen=True)
class Export(RunsCode, MakesRun):
    """Write the controller of a run as a law that streams: any part, hold, restart; and check it.

    C99 when no language is named.
    """

    run: Positional[Path] = Path()
    """Run folder of `jcontour tune` or `jcontour simulate`."""
    c: bool = False
    """C99 without allocation or libraries, and a program that replays the run."""
    st: bool = False
    """IEC 61131-3 structured text: a function block."""
    python: bool = False
    """One file of Python that does the same."""
    linuxcnc: Path | None = None
    """Folder for components of LinuxCNC: the law, its machine for runs without hardware, HAL and
    INI to wire them, and how to load them."""
    along: str | None = None
    """Contour of the run that the code is checked on; its first one when not given."""
    single: bool = False  # double is exact
    """Numbers in single precision, for drives without double."""
