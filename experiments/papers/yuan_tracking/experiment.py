"""Yuan 2020, chapter 3: tracking with a flexible axis, Tables 3.1 and 3.2, Figs 3.8 to 3.11, and every controller tuned and ranked.

The thesis's tables were measured on its test bench: our simulation of its model stands beside them
and is not fitted to them.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.papers.yuan_tracking.claims import claims, table_rows
from experiments.papers.yuan_tracking.figures import draw
from experiments.papers.yuan_tracking.runs import (
    BASELINE,
    Bench,
    Signals,
    gap_curve,
    metrics,
    on_the_family,
    tuned_weights,
)
from experiments.papers.yuan_tracking.tables import show
from jcontour.controller import Controller

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = "M. Yuan: Contouring control of machines with structural flexibility, PhD thesis, chapter 3 (performance of tracking control)"


class Measured(NamedTuple):
    """A row of Tables 3.1 and 3.2: errors and deformation [mm], mean current [A], computing per sample [ms], on the test bench."""

    task: str
    name: str
    em_max: float
    em_mean: float
    ee_max: float
    ee_mean: float
    def_max: float
    u_mean: float
    time_ms: float


PUBLISHED = (
    Measured("A", "Cascaded PI", 4.002, 1.603, 6.556, 1.722, 2.556, 0.744, 0.026),
    Measured("A", "Cascaded PI with filter", 4.001, 1.596, 6.271, 1.695, 2.272, 0.707, 0.028),
    Measured("A", "Cascaded PI with LESO", 3.963, 1.379, 8.953, 1.823, 6.910, 1.743, 0.027),
    Measured("B", "Cascaded PI", 3.358, 1.975, 3.552, 2.053, 0.830, 0.595, 0.0115),
    Measured("B", "Cascaded PI with filter", 3.344, 1.968, 3.535, 2.043, 0.551, 0.553, 0.0118),
    Measured("B", "Cascaded PI with LESO", 4.044, 1.969, 11.758, 4.394, 9.105, 2.118, 0.0117),
)
CONFIRMED = (BASELINE, "cascade-feedforward")  # of the project's own targets
# every so many samples of a signal are kept for the figures: 5 ms, a fourteenth of the link's
# period
KEPT = 5
DRAWN = (BASELINE, "cascade-notch", "cascade-leso-exact")  # Figs 3.8 to 3.11


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce yuan-tracking`."""

    quick: bool = False
    """Finish within a minute: nothing is tuned, the ranking is that of the first gains."""
    tuned: tuple[str, ...] = ()
    """Controllers that are tuned, by their names in `jcontour list`; all that suit the axis when none is given."""


def run(settings: Settings, folder: Path) -> dict[str, Any]:
    """Simulate everything; all that is found is in the summary, nothing is written to the folder.

    Raises:
        ValueError: no such controller of flexible axes.
    """
    bench = Bench()
    known = bench.controllers()
    for name in settings.tuned:
        if name not in known:
            raise ValueError(
                f"tuned: there is no controller {name!r} of flexible axes; give some of {', '.join(known)}"
            )
    to_tune = () if settings.quick else settings.tuned or tuple(known)
    rows, signals = _all_runs(bench, known, to_tune)
    summary: dict[str, Any] = {
        "source": SOURCE,
        "settings": asdict(settings),
        "ranking": rows,
        "signals": signals,
        "gap": gap_curve(bench),
    }
    summary["tables"] = table_rows(PUBLISHED, rows)
    summary["claims"] = claims(summary, CONFIRMED)
    return summary


def _all_runs(
    bench: Bench, known: Sequence[str], to_tune: Sequence[str]
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Rows of the ranking, and the signals of Figs 3.8 to 3.11."""
    rows, signals = [], {}
    with ThreadPoolExecutor(
        2
    ) as pool:  # compiling takes longer than simulating, and lets other threads go on
        found = list(
            pool.map(
                lambda name: _of_one(
                    bench, name, name in to_tune, bool(to_tune) and name == BASELINE
                ),
                known,
            )
        )
    for name, of_one in zip(known, found, strict=True):
        if name in DRAWN:
            signals[name] = {task: _thinned(one) for task, one in of_one[0].signals.items()}
        rows += [_row(bench, one) for one in of_one]
    return rows, signals


class _Tracked(NamedTuple):
    """A controller with some gains, and what it does."""

    name: str
    gains: str
    weights: dict[str, Any]
    controller: Controller
    signals: dict[str, Signals]
    family: list[dict[str, Any]]


def _of_one(bench: Bench, name: str, tune: bool, compared: bool) -> list[_Tracked]:
    design = bench.design(name)
    found = []
    for gains, weights in [("start", design.start)] + (
        [("tuned", tuned_weights(name))] if tune else []
    ):
        controller = design.build(weights)
        family = on_the_family(bench, controller) if tune or compared else []
        found.append(_Tracked(name, gains, weights, controller, bench.signals(controller), family))
    return found


def _row(bench: Bench, one: _Tracked) -> dict[str, Any]:
    return {
        "controller": one.name,
        "gains": one.gains,
        "weights": {key: np.asarray(value).tolist() for key, value in one.weights.items()},
        **{task: metrics(signals) for task, signals in one.signals.items()},
        "family": one.family,
        "time_us": 1e6 * bench.time_per_sample(one.controller),  # alone: the others have ended
    }


def _thinned(signals: Signals) -> dict[str, list[float]]:
    return {name: row[::KEPT].tolist() for name, row in signals._asdict().items()}
