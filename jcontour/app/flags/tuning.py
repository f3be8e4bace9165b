"""Flags of the commands that look for weights."""

from dataclasses import dataclass
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from jcontour.app.flags.shared import ROLLOUTS, Aimed, Rollouts, Storage

Against = Literal["increment", "sensitivity", "feed"]


@dataclass(frozen=True)
class Tune(Aimed):
    """Tune the weights of a controller by gradient.

    The contours are your toolpaths, or the machine's built-in training set.
    """

    RARE = (
        *Aimed.RARE,
        *("scatter", "starts", "every_start", "steps", "tolerance", "rollouts", "max_error_ratio"),
    )

    parts: Positional[tuple[str, ...]] = ()
    """Training set: toolpaths (.ngc G-code, .dxf and .svg drawings, .csv points in mm),
    or names from `jcontour list`. The machine's usual one when none is given."""
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
class Front(Aimed):
    """Trace the trade-off of contour error against control increment, robustness, or feed.

    The RMS tracking error keeps the limit that `tune` gives it, or the one that is given.
    """

    parts: Positional[tuple[str, ...]] = ()
    """Toolpaths (.ngc, .dxf, .svg, .csv) or names from `jcontour list`.
    The machine's usual contour when none is given. --against feed: one of them, or a run folder of
    `jcontour tune` or `simulate`: its first part, with its machine, controller and weights."""
    against: Against = "increment"  # the front of the paper's machine
    """Budgets along the front.
    increment: of the RMS control increment. sensitivity: of the peak sensitivity Ms.
    feed: nothing is tuned; the quickest of --overrides within every limit is recommended, as
    --max-peak-contour-error-um."""
    overrides: tuple[float, ...] = (25.0, 50.0, 75.0, 100.0, 150.0, 200.0)
    """--against feed: feeds in per cent of the programmed ones; rapid moves stay."""
    points: int = 5  # each budget is tuned by itself
    """Number of budgets along the front."""
    least: Annotated[float | None, arg(aliases=["--least-increment"])] = None
    """Smallest budget: an RMS increment [control unit per sample], or Ms.
    When not given, 1 % above the least increment within all other limits, or Ms = 1.4."""
    most: Annotated[float | None, arg(aliases=["--most-increment"])] = None
    """Largest budget, likewise.
    When not given, the increment of the best weights without a budget, or Ms = 3."""
    max_count_noise: float | None = None  # the budgets limit the control
    """Limit on the RMS control that the rounding of encoders to counts causes, as a part of the
    machine's control limit; None for no limit."""


@dataclass(frozen=True)
class Rank(Aimed):
    """Tune every controller that suits a machine alike, and rank them on held-out contours.

    Alike: sensors, family, margin, other limits and evaluations.
    """

    REFUSED = ("controller", "weights")  # it takes several, and each begins at its own weights

    parts: Positional[tuple[str, ...]] = ()
    """Training set: toolpaths (.ngc, .dxf, .svg, .csv) or names from `jcontour list`.
    The machine's usual one when none is given."""
    controllers: tuple[str, ...] = ()
    """Names from `jcontour list`, or FILE.py:NAME.
    When not given, every one that suits the machine, reads its sensors and does not learn while it
    runs."""
    evaluations: int = 40  # most descents have ended before
    """Points that each controller may evaluate, with slopes."""


@dataclass(frozen=True)
class Sweep(Storage):
    """Evaluate a grid, or a random sample, over weights x preview x contours."""

    parts: Positional[tuple[str, ...]] = ()
    """Toolpaths (.ngc, .dxf, .svg, .csv) or names from `jcontour list`.
    The machine's usual contours when none is given."""
    vary: tuple[str, ...] = ()
    """Weights by name, each as NAME=VALUE,VALUE,...: a grid, or the ranges of the random sample.
    When not given, the first two free weights that are one positive number equal on all axes.
    Gains go from a tenth to ten times their start, weights of a cost from a hundredth to ten
    thousand times."""
    previews: tuple[int, ...] = (5, 10, 20)  # half, once and twice the paper's
    """Horizons of an LQ controller [samples]. A controller that has none is swept once."""
    samples: int = 0  # the grid
    """Random weights between the smallest and the largest value, even in the logarithm, so that
    all values are above zero; 0 takes the grid."""
    devices: str = "all"  # every design is computed by itself: no digit depends on it
    """Devices that designs are spread over: `all`, or a number.
    Devices are GPUs, or else cores of the CPU."""
