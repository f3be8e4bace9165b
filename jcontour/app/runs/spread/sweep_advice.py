"""What a sweep says of its designs: which diverge or break a limit, and what to run next."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from jcontour.app.files.results.run_metrics import METRICS
from jcontour.app.files.results.search_results import BestDesign, SweepResult
from jcontour.app.flags.shared import Controlled, Limited
from jcontour.app.reports.figures.sweeps import worst_errors
from jcontour.app.runs.lifecycle import task_words
from jcontour.app.runs.spread.best_designs import ALIKE, LOOPS, largest_of
from jcontour.app.runs.spread.sweep_runs import Swept, kept_weights
from jcontour.app.runs.tuning.limits import named_limits
from tuning.objectives import COUNT_NOISE, LATE

BEYOND = {  # limit on loops -> what is said of a design that breaks it, with its value
    "peak_sensitivity": "its Ms is {:.3g}",
    LATE: "a loop does not bear the delay that --min-delay-margin asks for",
    COUNT_NOISE: "the rounding of encoders causes {:.3g} RMS control",
    "spectral_radius": "with its gains frozen a loop is unstable",
}
NAMED = 5  # diverged designs that are printed; all of them are in the figure and in the netCDF file


def diverged_lines(dataset: xr.Dataset, names: list[str], error: str) -> list[str]:
    """The first diverged designs by name."""
    _, diverged = worst_errors(dataset, error)
    places = np.argwhere(diverged)
    lines = []
    for p, i in places[:NAMED]:
        weights = ", ".join(f"{name} {float(dataset[name][i]):.4g}" for name in names)
        lines.append(f"Diverged: preview {int(dataset.preview[p])}, {weights}")
    if len(places) > NAMED:
        lines.append(f"and {len(places) - NAMED} more: red crosses in the figure")
    return lines


def limit_lines(asked: Swept, dataset: xr.Dataset, result: SweepResult) -> list[str]:
    """What keeps a limit nowhere, and what was passed over for limits on loops."""
    lines = []
    for place in np.flatnonzero(dataset.best.values < 0).tolist():
        one = dataset.isel(preview=[place])
        lost = worst_errors(one, asked.machine.error)[1][0]
        if lost.all():
            continue
        least = []  # what comes nearest to each limit
        for name, bound in named_limits(asked.flags).items():
            metric = METRICS[name]
            value = metric.factor * float(largest_of(one, name)[0, ~lost].min())
            unit = metric.shown(asked.machine.control_unit)
            least.append(f"{metric.words} {value:.4g} {unit} (limit {metric.factor * bound:.4g})")
        lines.append(
            f"preview {int(one.preview[0])}: none of {lost.size} designs keeps the limits; "
            f"the least of each: {', '.join(least)}"
        )
    for row in result.best:
        where, better = f"preview {row.preview}", row.looked - 1
        if row.beyond:
            what = ", ".join(BEYOND[name].format(value) for name, value in row.beyond.items())
            also = f", and {better} next best ones break a limit as well" if better else ""
            lines.append(f"{where}: the best design breaks a limit: {what}{also}")
        elif better:
            lines.append(
                f"With {where}, {better} design{'s' if better > 1 else ''} with less error or a "
                "calmer control break a limit on the loops: Ms, delay margin or noise of counts"
            )
    return lines


def _leading(best: Sequence[BestDesign]) -> BestDesign:
    """The design with the least error, of those that break no limit if there are any."""
    return min(best, key=lambda row: (bool(row.beyond), row.worst_um))


def margin_lines(asked: Swept) -> list[str]:
    """Designs whose margins are those of the loop they begin with, or are not stored."""
    lines = []
    if any(asked.design(preview).learns for preview in asked.flags.previews):
        lines.append("The controller learns: Ms and delay margin are of the loop it begins with")
    if asked.count > LOOPS:
        lines.append(f"Ms and delay margin are stored of the {LOOPS} best designs of every preview")
    return lines


def next_steps(asked: Swept, result: SweepResult) -> list[str]:
    """What to run next: the tuner from the best design, or other weights."""
    if not result.best and result.diverged < result.points:
        return ["no design keeps the limits; allow more, or sweep other weights with --vary."]
    if not result.best:
        return ["every design diverges; sweep smaller weights with --vary."]
    best = _leading(result.best)
    given = dict(words.split("=", 1) for words in asked.flags.weights)
    weights = given | {name: f"{value:.6g}" for name, value in best.weights.items()}
    words = task_words(asked.flags.parts, _flags_with(asked, best, weights), Limited)
    return [f"jcontour tune{words}"]


def repeated(asked: Swept, result: SweepResult) -> list[str]:
    """The command that runs the best point again, with all digits, along the first contour."""
    if not result.best:
        return []
    best = _leading(result.best)
    design = asked.design(best.preview)
    weights = {name: repr(value) for name, value in best.weights.items()}
    for name, value in kept_weights(asked, [design]).items():
        weights[name] = ",".join(map(repr, np.ravel(value).tolist()))
    flags = _flags_with(asked, best, weights)
    late = design.settings().get("model_delay")
    flags |= {} if late is None else {"model_delay": late}
    first = (asked.flags.parts or asked.machine.usual.swept)[:1]
    words = task_words(first, flags, Controlled)
    return [f"jcontour simulate{words}"]


def _flags_with(asked: Swept, best: BestDesign, weights: Mapping[str, str]) -> dict[str, Any]:
    """Flags of a command that begins with these weights."""
    flags = vars(asked.flags) | {name: None for name in weights if name in vars(asked.flags)}
    flags |= {"weights": [f"{name}={value}" for name, value in weights.items()]}
    if len(asked.flags.previews) > 1 or asked.design(best.preview).settings().get("terminal"):
        flags |= {"preview": best.preview}
    return flags


def edge_of(asked: Swept, result: SweepResult, dataset: xr.Dataset) -> list[str]:
    """A line for every weight whose best value lies on the edge of its grid."""
    if asked.flags.samples or not result.best:  # a random sample has no edge
        return []
    best = _leading(result.best)
    here = dataset.sel(preview=[best.preview])
    worst, _ = worst_errors(here, asked.machine.error)
    kept = here.within_limits.values[0].astype(bool)
    return edge_lines(best.weights, asked.values, np.where(kept, worst[0], np.inf))


def edge_lines(
    best: Mapping[str, float],
    values: Mapping[str, Float[Array, " D"]],
    worst: Float[np.ndarray, " D"],
) -> list[str]:
    """A line for every weight that is best at the end of its grid, if none is as good inside."""
    ends = {name: (grid.min(), grid.max()) for name, grid in values.items() if np.ptp(grid) > 0}
    inside = np.ones(len(worst), bool)
    for name, (low, high) in ends.items():
        inside &= np.asarray((values[name] > low) & (values[name] < high))
    if worst[inside].min(initial=np.inf) <= (1 + ALIKE) * worst.min():
        return []
    return [
        f"The best {name}, {best[name]:.6g}, lies on the edge of the grid: "
        f"try {'smaller' if best[name] == places[0] else 'larger'} ones with --vary."
        for name, places in ends.items()
        if best[name] in places
    ]
