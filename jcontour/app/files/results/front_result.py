"""Result of `jcontour front`: what `result.json` and `front.nc` of its run folder hold."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from jcontour.app.files import run_folder
from jcontour.app.files.results.run_metrics import METRICS
from jcontour.app.files.results.stored import BESIDE_OTHERS, Weight
from jcontour.app.flags.tuning import Against

SHOWN = ("rms_contour_error", "rms_tracking_error", "rms_increment", "peak_sensitivity")


@dataclass(frozen=True)
class MachineUnits:
    """Units of the machine that the numbers need."""

    control_unit: str


@dataclass(frozen=True)
class BudgetPoint:
    """The best weights found within one budget, on the smooth machines.

    Attributes:
        budget: largest RMS control increment [control unit per sample], or peak sensitivity.
        weights: those that are one number, or one for each axis.
        rms_contour_error: worst over contours and family [m]; so are the next two.
        rms_tracking_error: [m].
        rms_increment: [control unit per sample].
        objective: what was made small: an error [m], or a ratio of two.
        feasible: whether every limit holds.
        slack: whether the weights need clearly less than the budget.
        peak_sensitivity: largest Ms over the probes of the contours and the family; infinite where
            a frozen loop is not stable.
    """

    budget: float
    weights: dict[str, Weight] = field(metadata=BESIDE_OTHERS)
    rms_contour_error: float
    rms_tracking_error: float
    rms_increment: float
    objective: float
    feasible: bool
    slack: bool
    peak_sensitivity: float

    def error(self, name: str) -> float:
        """Worst RMS error of a name, contour or tracking [m]."""
        return getattr(self, f"rms_{name}_error")

    def spent(self, against: Against) -> float:
        """What the weights need of the quantity that the budgets limit."""
        return self.rms_increment if against == "increment" else self.peak_sensitivity


@dataclass(frozen=True)
class FrontResult:
    """A front.

    Attributes:
        machine: its units.
        error: name of the error that counts on the machine, contour or tracking.
        controller: name in the catalogue.
        weights: names of the free weights.
        points: one for every budget, from the smallest.
        tracking_cap: limit on the RMS tracking error that no flag asked for [m]; None without it.
        against: what the budgets limit.
        nominal_only: the family is the nominal plant alone.
    """

    machine: MachineUnits
    error: str
    controller: str
    weights: list[str]
    points: list[BudgetPoint]
    tracking_cap: float | None = None
    against: Against = "increment"
    nominal_only: bool = False

    @property
    def slack(self) -> list[float]:
        """Budgets that are not used up."""
        return [point.budget for point in self.points if point.slack]


def dataset_of(result: FrontResult, weight_units: dict[str, str]) -> xr.Dataset:
    """The front along its budgets; a weight with a number for each axis has a second dimension."""
    unit = result.machine.control_unit

    def along(values: Sequence[Any], of: str, second: str = "") -> tuple[list[str], Any, Any]:
        column = np.array(values, float)
        return ["budget", second][: column.ndim], column, {"units": of}

    data: dict[str, Any] = {}
    for name, of in weight_units.items():
        data[name] = along([point.weights[name] for point in result.points], of, f"entry_of_{name}")
    for name in SHOWN:
        values = [getattr(point, name) for point in result.points]
        of = "1" if name == "peak_sensitivity" else METRICS[name].si(unit)
        data[name] = along(values, of)
    for name in ("feasible", "slack"):
        data[name] = along([float(getattr(point, name)) for point in result.points], "1")
    of = unit if result.against == "increment" else "1"
    budgets = along([point.budget for point in result.points], of)
    attributes = {"title": f"jcontour front: error against {result.against}"}
    return xr.Dataset(data, {"budget": budgets}, {**attributes, **run_folder.versions()})
