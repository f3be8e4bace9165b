"""The flags of every command. Imports nothing heavy, so that `jcontour --help` answers at once."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from experiments.shared_options import (
    Aimed,
    Bounded,
    Common,
    Controlled,
    MachineFlags,
    Spreading,
    Terminal,
)

Against = Literal["increment", "sensitivity"]
Fallback = Literal["stop", "hold", "soft"]
Rollouts = Literal["auto", "full", "thinned", "none"]
Law = Literal["norm-optimal", "p-type"]

ROLLOUTS: Rollouts = "auto"  # all that fits into 100 MB
FALLBACK: Fallback = "stop"  # no number comes from a step that was not solved
SOLVER = "daqp"  # exact to rounding and the fastest


@dataclass(frozen=True)
class Tune(Aimed):
    """Tune the weights of a controller by gradient.

    The contours are your toolpaths, or the machine's built-in training set.
    """

    parts: Positional[tuple[str, ...]] = ()
    """Training set: toolpaths (.ngc G-code, .dxf and .svg drawings, .csv points in mm),
    or names from `jcontour list`. The machine's usual one when none is given."""
    contours: str | None = None
    """Training set of random contours instead, as random:64, in the size and feed of the parts.
    As many others are held out. --seed draws other ones."""
    max_error_ratio: float | None = None
    """Limit on the worst error of every training contour, over that of the start weights.
    1 lets none become worse, 0.95 asks for 5 % on each of them."""
    scatter: int = 6  # looked at before descending; more when the seconds do not count
    """Random weights looked at before descending."""
    starts: int = 2  # the given weights and the best of the scattered ones
    """Descents: from the start weights, and from the best random ones.
    A descent that ends where nothing promises more, within the limits, is the last one."""
    every_start: bool = False  # a look for other valleys
    """Descend from the random ones whatever the first descent finds."""
    steps: int = 15  # most descents end by themselves before
    """Most iterations of one descent; each runs the family once or twice."""
    tolerance: float = 1e-3  # a tenth of a per cent: less than a plant model is good for
    """Relative gain of the objective that ends a descent when nothing promises more."""
    rollouts: Rollouts = ROLLOUTS
    """Samples kept in rollouts.nc: all, some, or no file; `auto` thins what is large.
    Figures are drawn from all."""


@dataclass(frozen=True)
class Simulate(Controlled):
    """Simulate one controller on one contour: table, figures, netCDF."""

    contour: Positional[str | None] = None
    """A name from `jcontour list`, or a toolpath file (.ngc, .dxf, .svg, .csv).
    The machine's usual contour when not given."""
    video: bool = False  # it needs MuJoCo and a renderer
    """Gantry: film its MuJoCo model on the contour, the twist of the beam magnified.
    MP4 with the extra `video`, else GIF."""
    rollouts: Rollouts = ROLLOUTS
    """Samples kept in rollouts.nc: all, some, or no file; `auto` thins what is large.
    Figures are drawn from all."""
    list_moves: bool = False  # a long program fills the screen
    """Print the moves of a program or a drawing as they were understood, and simulate nothing."""
    out: Path | None = None
    """Run folder; runs/simulate-<time> when not given. It must not hold another run."""


@dataclass(frozen=True)
class Feed(Controlled):
    """Trade cycle time for contour error: the same part and controller at several feeds.

    The motion is planned anew for each of them.
    """

    part: Positional[str | None] = None
    """A toolpath (.ngc, .dxf, .svg, .csv), a name from `jcontour list`, or a run folder of
    `jcontour tune` or `simulate`: its first part, with its machine, controller and weights.
    The machine's usual contour when not given."""
    overrides: tuple[float, ...] = (25.0, 50.0, 75.0, 100.0, 150.0, 200.0)
    """Feeds in per cent of the programmed ones; rapid moves stay."""
    tolerance_um: float | None = None
    """Largest contour error that any plant of the family may have [um].
    The quickest feed within it is recommended."""
    out: Path | None = None
    """Run folder; runs/feed-<time> when not given. It must not hold another run."""


@dataclass(frozen=True)
class Precompensate(Controlled):
    """Bend the reference of a part beforehand, so that the tool of the whole family runs on it.

    The controller stays as it is: any control runs the bent reference, as samples or as G-code.
    """

    part: Positional[str | None] = None
    """A toolpath (.ngc, .dxf, .svg, .csv), a name from `jcontour list`, or a run folder of
    `jcontour tune` or `simulate`: its first part, with its machine, controller and weights.
    The machine's usual contour when not given."""
    roughness: float = 0.01  # the least with which no run of ours shook an axis
    """Price of the bends of the correction. More is smoother and follows less.
    It is raised tenfold while a limit of the machine is exceeded."""
    out: Path | None = None
    """Run folder; runs/precompensate-<time> when not given. It must not hold another run."""


@dataclass(frozen=True)
class Compare(Common):
    """Compare two tuned runs: what changed in the settings, and which is better where."""

    first: Positional[Path] = Path()
    """Run folder."""
    second: Positional[Path] = Path()
    """Run folder."""


@dataclass(frozen=True)
class Report(Common):
    """Write one page of stored runs for a browser: everything inside, nothing loaded."""

    runs: Positional[tuple[Path, ...]] = ()
    """Run folders of `jcontour tune`, `simulate` or `front`."""
    out: Path | None = None
    """The page; report.html in the first folder when not given."""


@dataclass(frozen=True)
class Listing(Common):
    """List the plants, controllers, contours and experiments that have names."""


@dataclass(frozen=True)
class Front(Aimed):
    """Trace the trade-off of contour error against control increment, or against robustness.

    A tracking cap holds if one is given.
    """

    parts: Positional[tuple[str, ...]] = ()
    """Toolpaths (.ngc, .dxf, .svg, .csv) or names from `jcontour list`.
    The machine's usual contour when none is given."""
    against: Against = "increment"  # the front of the paper's machine
    """Budgets along the front.
    increment: of the RMS control increment. sensitivity: of the peak sensitivity Ms."""
    points: int = 5  # each budget is tuned by itself
    """Number of budgets along the front."""
    least: Annotated[float | None, arg(aliases=["--least-increment"])] = None
    """Smallest budget: an RMS increment [control unit per sample], or Ms.
    When not given, three quarters of the largest increment, or 1.4."""
    most: Annotated[float | None, arg(aliases=["--most-increment"])] = None
    """Largest budget, likewise.
    When not given, the increment of the best weights without a budget, or Ms = 3."""


@dataclass(frozen=True)
class Rank(Aimed):
    """Tune every controller that suits a machine alike, and rank them on held-out contours.

    Alike: sensors, family, margin, other limits and evaluations.
    """

    parts: Positional[tuple[str, ...]] = ()
    """Training set: toolpaths (.ngc, .dxf, .svg, .csv) or names from `jcontour list`.
    The machine's usual one when none is given."""
    controllers: tuple[str, ...] = ()
    """Names from `jcontour list`, or FILE.py:NAME.
    Every one that suits the machine and reads its sensors when not given."""
    previews: tuple[int, ...] = ()
    """LQ: horizons that are tried beside each other [samples]; that of --preview when not given."""
    terminals: tuple[Terminal, ...] = ()
    """LQ: ends of the horizon that are tried beside each other; likewise."""
    model_delays: tuple[int, ...] = ()
    """LQ: delays of the model that are tried beside each other [samples]; likewise."""
    evaluations: int = 40  # most descents have ended before
    """Points that each controller may evaluate, with slopes."""


@dataclass(frozen=True)
class Sweep(Spreading):
    """Evaluate a grid, or a random sample, over weights x preview x contours.

    With --controller mpcc or tracking-mpc: over weights x horizon x speed, each run by itself.
    """

    parts: Positional[tuple[str, ...]] = ()
    """Toolpaths (.ngc, .dxf, .svg, .csv) or names from `jcontour list`.
    The machine's usual contours when none is given."""
    vary: tuple[str, ...] = ()
    """Weights by name, each as NAME=VALUE,VALUE,...: a grid, or the ranges of the random sample.
    When not given, the first two free weights that are one positive number equal on all axes.
    These go from a tenth to ten times their start."""
    previews: tuple[int, ...] = (5, 10, 20)  # half, once and twice the paper's
    """Horizons of an LQ controller or of predictive control [samples].
    A controller that has none is swept once."""
    speeds_mm_s: tuple[float, ...] = ()
    """Predictive control: speeds along the path [mm/s]; of mpcc the highest ones.
    The paper's when not given."""
    samples: int = 0  # the grid
    """Random weights between the smallest value above zero and the largest; 0 takes the grid."""
    devices: str = "all"  # every design is computed by itself: no digit depends on it
    """Devices of every host that designs are spread over: `all`, or a number.
    Devices are GPUs, or else cores of the CPU."""
    workers: int | None = None
    """Predictive control: processes on this computer that designs are spread over.
    One for each core when not given, which needs the extra `cluster`; 0 computes in this one."""
    scheduler: str | None = None
    """Predictive control: address of a dask scheduler that runs, as tcp://host:8786, instead."""


@dataclass(frozen=True)
class Verify(Common):
    """Replay a tuned run through a constrained MPC with the same weights.

    The tables say where limits act, and what they cost.
    """

    run: Positional[Path] = Path()
    """Run folder of `jcontour tune`."""
    max_control: float | None = None
    """Limit on every control [control unit]; the machine's own when not given."""
    max_increment: float | None = None
    """Limit on the change of every control per sample [control unit].
    The machine's own when not given."""
    max_speed_mm_s: float | None = None
    """Limit on the speed of every axis [mm/s]; the machine's own when not given."""
    max_acceleration: float | None = None
    """Limit on the acceleration of every axis [m/s^2]; the machine's own when not given."""
    fallback: Fallback = FALLBACK
    """Action at a step whose QP has no answer.
    Stop the run, hold the last control, or soften the limits."""
    solver: str = SOLVER
    """QP solver: daqp, proxqp, or any that qpsolvers finds installed."""
    out: Path | None = None
    """Run folder; runs/verify-<time> when not given. It must not hold another run."""


@dataclass(frozen=True)
class Certify(Bounded):
    """Prove the largest contour error that a loop can have under bounded disturbances.

    Beside it stands the error that an attack within the bounds really reaches.
    """

    run: Positional[Path] = Path()
    """Run folder of `jcontour tune` or `jcontour simulate`, of a linear machine."""
    cells: int = 0  # each takes seconds, on a long part half a minute
    """Prove it for all gains of the family's box too, cut into at most so many cells per delay.
    16 are enough for two axes of 10 %. 0: for the plants of the family alone."""
    out: Path | None = None
    """Run folder; runs/certify-<time> when not given. It must not hold another run."""


@dataclass(frozen=True)
class Tolerance(Bounded, MachineFlags):
    """Find the tolerance that predictive control can promise on a part, and run it.

    The tool stays within it under every force and encoder error within bounds, and within the
    machine's limits on control and speed. The machine's other plants are run as well.
    """

    contour: Positional[str | None] = None
    """A name from `jcontour list`, or a toolpath file (.ngc, .dxf, .svg, .csv).
    The machine's usual contour when not given."""
    tolerance_um: float | None = None
    """Tolerance to keep [um]; the least that can be promised, and 2 %, when not given.
    A larger one leaves room for gentler controls."""
    length: int | None = None
    """Samples within which the tool has recovered from a disturbance.
    When not given, the shortest of 8, 12, 20 and 30 that promises as much as the others."""
    model_delay: int = 0  # the nominal plant
    """Samples of the machine's unknown delay that its model has.
    What is promised holds for a machine that is as late."""
    offset_free: bool = True  # friction is as good as constant on a straight line
    """A constant force leaves no error; it costs some of the tolerance."""
    solver: str = SOLVER
    """QP solver: daqp, proxqp, or any that qpsolvers finds installed."""
    out: Path | None = None
    """Run folder; runs/tolerance-<time> when not given. It must not hold another run."""


@dataclass(frozen=True)
class Export(Common):
    """Write the controller of a run as code for a drive, with its plan, and check it.

    C99 when no language is named.
    """

    run: Positional[Path] = Path()
    """Run folder of `jcontour tune` or `jcontour simulate`."""
    c: bool = False
    """C99 without allocation or libraries, and a program that replays the run."""
    st: bool = False
    """IEC 61131-3 structured text: a function block."""
    python: bool = False
    """One file of plain NumPy that does the same."""
    along: str | None = None
    """Contour of the run that the plan is made for; its first one when not given."""
    single: bool = False  # positions in metres need double
    """Numbers in single precision, for drives without double."""
    out: Path | None = None
    """Run folder; runs/export-<time> when not given. It must not hold another run."""


@dataclass(frozen=True)
class Trace(Common):
    """Trace a contour with model predictive contouring control, which chooses its own speed."""

    contour: Positional[str] = (
        "lobes"  # size and tight curves of the contour in Lam, Manzie & Good (2011)
    )
    """A name from `jcontour list`, or a toolpath file (.ngc, .dxf, .svg, .csv)."""
    plant: str = "xy-table"  # the paper's
    """Machine: a name from `jcontour list`, or a JSON or npz file; its whole state is measured."""
    q_theta: float = 0.3  # the middle of the paper's range 0.03 .. 5
    """Reward for progress [1/mm]: more is faster and less accurate."""
    q_contour: float = 100.0  # the paper's
    """Weight on the contour error [1/mm^2]."""
    q_lag: float = 200.0  # the paper's
    """Weight on the lag error [1/mm^2]; large, or progress is not what it says."""
    r_control: float = 60.0  # the paper's
    """Weight on the change of every control from step to step [1/control unit^2]."""
    r_speed: float = 200.0  # the paper's
    """Weight on the change of the path speed from step to step [1/(mm per step)^2]."""
    horizon: int = 7  # the paper's, section 5
    """Steps that the controller looks ahead, at most 100."""
    period_ms: float | None = None
    """Period of the controller [ms]; 4 for the table, that of the machine otherwise."""
    max_speed_mm_s: float = 250.0  # the paper's 1 mm per 4 ms
    """Highest path speed [mm/s]."""
    max_control: float | None = None
    """Limit on every control; the machine's own when not given."""
    fallback: Fallback = FALLBACK
    """Action at a step whose QP has no answer.
    Stop the run, hold the last control, or soften the limits."""
    solver: str = SOLVER
    """QP solver: daqp, proxqp, or any that qpsolvers finds installed."""
    out: Path | None = None
    """Run folder; runs/trace-<time> when not given. It must not hold another run."""


@dataclass(frozen=True)
class Learn(Controlled):
    """Learn a part lap by lap: error per lap, with encoder noise and parameter error.

    Before the first lap it is said whether the laps converge, by linear models of the family.
    """

    contour: Positional[str | None] = None
    """A name from `jcontour list`, or a toolpath file (.ngc, .dxf, .svg, .csv).
    The machine's usual contour when not given."""
    laps: int = 20  # most learn in five
    """Laps of the whole run; each one starts alike."""
    law: Law = "norm-optimal"  # knows the model and the direction of the path
    """Learning law: norm-optimal on the contour error, or p-type on the error itself."""
    effort: float = 0.1  # nine tenths of a slow contour error are learned in a lap
    """Norm-optimal: price of a change of the correction; more is slower, and averages noise."""
    gain: float = 0.5  # half of the error is learned in a lap
    """P-type: part of the error that is taken over."""
    lead: int | None = None
    """P-type: samples by which the error is read ahead; the lag of the loop when not given."""
    smoothing: int | None = None
    """How often the filter (1/4, 1/2, 1/4) is passed over the correction.
    When not given, as often as the bound over the family needs."""
    seed: int = 0  # any number: the same one repeats the run
    """Seed of the encoder noise."""
    out: Path | None = None
    """Run folder; runs/learn-<time> when not given. It must not hold another run."""


@dataclass(frozen=True)
class Bench(Common):
    """Time the library on this computer.

    Times are ratios against something run beside it; hardware and versions are named.
    """

    what: Positional[
        Literal[
            "mpc",
            "qp",
            "lq",
            "gantry",
            "tuners",
            "identify",
            "whole_way",
            "motion",
            "certificates",
        ]
    ] = "mpc"  # it has to fit a sample period
    """Timed part of the library.
    mpc: one step of the constrained controllers, by part and by solver.
    qp: many problems of constrained control at once, with their slopes.
    lq: whole runs of the LQ contouring controller.
    gantry: the gantry in every engine.
    tuners: the tuner against searches without slopes, hours; `uv run --group bench`.
    identify: random axes, recorded and identified again, minutes each.
    whole_way: from the log of a hidden machine to the contour error there, minutes each.
    motion: random toolpaths, planned and compared with their limits.
    certificates: a certified bound with its slopes, and random laps against it."""
    batch: tuple[int, ...] = ()
    """LQ: runs at once, what suits the device when not given.
    Gantry: machines at once, 1000 when not given. Certificates: laps at once.
    QP: problems at once, 128 when not given."""
    seeds: int = 20  # quartiles of fewer say little
    """Tuners: random starts of every search. Identify, whole_way: machines of two axes.
    Motion: paths. Certificates: batches of laps."""
    first_seed: int = 0
    """Motion, certificates, whole_way: seed of the first path, batch or machine."""
    searches: tuple[str, ...] = ()
    """Tuners: names of those that search, as the table has them; all when not given."""
    evaluations: int = 600  # CMA-ES needs hundreds at four weights
    """Tuners: evaluations of every search; one with slopes counts three.
    Whole_way: of every search at most, one with slopes counts one."""
    keep: Path | None = None
    """File that keeps what is done; with it, a second run goes on.
    Tuners: every start, JSON. Motion: every path, CSV."""
    figure: Path | None = None
    """Tuners: PNG file for the best value so far against evaluations."""


@dataclass(frozen=True)
class Reproduce(Common):
    """Reproduce a paper.

    `jcontour list` shows the names, `jcontour reproduce NAME --help` the flags of one.
    """

    name: Positional[str] = ""
    """Name of the experiment."""
