"""Results of `rank`, `front` and `sweep`."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jcontour.app.files.netcdf import Variables
from jcontour.app.files.results.run_metrics import METRICS, LoopResult, MachineSummary
from jcontour.app.files.results.stored import Weight
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.flags.tuning import Against

SHOWN = ("rms_contour_error", "rms_tracking_error", "rms_increment", "peak_sensitivity")


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """One tuned controller, on the machine with all effects; errors are RMS [m]."""

    label: str  # name in the catalogue, or FILE.py:NAME
    failure: str | None = None  # why it has no place, in one line; the numbers are None then
    # geometric mean over held-out contours of the family's worst error
    held_out: float | None = None
    training: float | None = None  # the same over training contours
    held_out_errors: dict[str, float] | None = None  # the family's worst error, contour by contour
    training_errors: dict[str, float] | None = None  # likewise
    # largest Ms at the probes of the training contours, over the family; None where a frozen loop
    # is unstable, or none is looked at
    peak_sensitivity: float | None = None
    # the controller changes while it runs; Ms is that of the loop that it begins with
    learns: bool = False
    feasible: bool = False  # whether every limit holds, those of the machine with all effects
    # limits of the machine that its runs do not keep, a line each
    exceeded: list[str] = field(default_factory=list)
    stationary: bool = False  # whether the search had ended
    evaluations: int = 0  # points that were evaluated
    weights: dict[str, Weight] | None = None  # by name
    # processor time of the runs of all contours and plants, compiled [s]
    seconds: float | None = None


@dataclass(frozen=True, kw_only=True)
class RankedResult:
    """All controllers, the best first; those that failed come last."""

    machine: MachineSummary
    error: str  # the error that counts, "contour" or "tracking"
    evaluations: int  # that each of them was allowed
    rows: list[Ranked]
    verdict: Verdict  # whether a controller keeps every limit
    # names of controllers that were left out, as they learn while they run
    learning: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class BudgetPoint:
    """The best weights within one budget, on the smooth machines; or the loop at one feed."""

    # largest RMS control increment [control unit per sample], or peak sensitivity; or the feed in
    # per cent of the programmed one
    budget: float
    weights: dict[str, Weight]  # those that are one number, or one for each axis
    rms_contour_error: float  # worst over contours and family [m]; so are the next two
    rms_tracking_error: float  # [m]
    rms_increment: float  # [control unit per sample]
    # what was made small: an error [m], or a ratio of two; at a feed the largest error [m]
    objective: float
    feasible: bool  # whether every limit holds
    slack: bool  # whether the weights need clearly less than the budget
    # largest Ms over the probes of the contours and the family; infinite where a frozen loop is not
    # stable, NaN at a feed
    peak_sensitivity: float
    cycle_time: float = 0.0  # at a feed, of the whole run or of one of its laps [s]
    # at a feed, limits that are exceeded first, then what of the motion to know
    messages: list[str] = field(default_factory=list)

    def error(self, name: str) -> float:
        """Worst RMS error of a name, contour or tracking [m]."""
        return getattr(self, f"rms_{name}_error")

    def spent(self, against: Against) -> float:
        """What the weights need of the quantity that the budgets limit; of a feed its time [s]."""
        name = {"increment": "rms_increment", "sensitivity": "peak_sensitivity"}.get(against)
        return getattr(self, name or "cycle_time")


@dataclass(frozen=True, kw_only=True)
class FrontResult(LoopResult):
    """A front."""

    weights: list[str]  # names of the free weights
    points: list[BudgetPoint]  # one for every budget, from the smallest
    # limit on the RMS tracking error that no flag asked for [m]; None without it
    tracking_cap: float | None = None
    against: Against = "increment"  # what the budgets limit, or "feed"
    nominal_only: bool = False  # the family is the nominal plant alone
    contour: str = ""  # of feeds
    recommended: float | None = None  # feed; None where none is
    verdict: Verdict | None = None  # on that feed; None of a search

    @property
    def slack(self) -> list[float]:
        """Budgets that are not used up."""
        return [point.budget for point in self.points if point.slack]


def variables_of(result: FrontResult, weight_units: dict[str, str]) -> Variables:
    """The front along its budgets; a weight with a number for each axis has a second dimension."""
    unit = result.machine.control_unit

    def along(values: Sequence[Any], of: str, second: str = "") -> tuple[list[str], Any, Any]:
        column = np.array(values, float)
        return ["budget", second][: column.ndim], column, {"units": of}

    data: Variables = {}
    for name, of in weight_units.items():
        data[name] = along([point.weights[name] for point in result.points], of, f"entry_of_{name}")
    for name in SHOWN:
        values = [getattr(point, name) for point in result.points]
        of = "1" if name == "peak_sensitivity" else METRICS[name].si(unit)
        data[name] = along(values, of)
    for name in ("feasible", "slack"):
        data[name] = along([float(getattr(point, name)) for point in result.points], "1")
    if result.against == "feed":
        data["cycle_time"] = along([point.cycle_time for point in result.points], "s")
        data["objective"] = along([point.objective for point in result.points], "m")
    of = {"increment": unit, "sensitivity": "1", "feed": "percent"}[result.against]
    return data | {"budget": along([point.budget for point in result.points], of)}


@dataclass(frozen=True)
class BestDesign:
    """The best weights with one preview within the limits, by the worst error of all runs.

    Of errors that are alike, those of the calmest control are the best.
    """

    preview: int  # [samples]
    weights: dict[str, float]  # those that vary, by name
    worst_um: float  # worst RMS error [um]
    nominal_um: float  # worst RMS error over the contours on the nominal plant [um]
    # peak Ms of the frozen loops over the family; None where one is unstable
    sensitivity: float | None
    delay_samples: int  # extra delay that the nominal loops bear; -1 where one is unstable as it is
    looked: int = 1  # designs whose loops were looked at, the best first, until one kept the limits
    # limits on loops that it breaks, with its values, SI; none did better
    beyond: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SweepResult:
    """Summary of a sweep; all numbers are in its netCDF file."""

    points: int  # designs with their previews
    diverged: int  # points that diverge on any plant along any contour
    within: int  # points that do not, and whose runs keep the limits of the flags
    best: list[BestDesign]  # one design for every preview with which any is within the limits
