"""Yuan 2020, chapter 3: tracking with a flexible axis, Tables 3.1 and 3.2, Figs 3.8 to 3.11.

Every controller of flexible axes is tuned and ranked as well. The thesis's tables were measured on
its test bench: our simulation of its model stands beside them and is not fitted to them.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.papers.yuan_tracking.claims import PublishedRow, claims, table_rows
from experiments.papers.yuan_tracking.figures import draw
from experiments.papers.yuan_tracking.result import (
    KEPT_PERIOD,
    Columns,
    FamilyRow,
    RankingRow,
    Result,
    Signals,
)
from experiments.papers.yuan_tracking.runs import (
    BASELINE,
    Setup,
    gap_curve,
    metrics,
    on_the_family,
    tuned_weights,
)
from experiments.papers.yuan_tracking.tables import show
from jcontour.controller import Controller

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = (
    "M. Yuan: A Model-based Approach for High Performance Motion Control in Industrial Machines. "
    "Doctoral thesis, The University of Melbourne (2020), chapter 3 "
    "(performance of tracking control)"
)
PI, FILTERED, OBSERVED = "Cascaded PI", "Cascaded PI with filter", "Cascaded PI with LESO"
PUBLISHED = (  # columns as in `Columns` [mm, A], then computing per sample [ms]
    PublishedRow("A", PI, Columns(4.002, 1.603, 6.556, 1.722, 2.556, 0.744), 0.026),
    PublishedRow("A", FILTERED, Columns(4.001, 1.596, 6.271, 1.695, 2.272, 0.707), 0.028),
    PublishedRow("A", OBSERVED, Columns(3.963, 1.379, 8.953, 1.823, 6.910, 1.743), 0.027),
    PublishedRow("B", PI, Columns(3.358, 1.975, 3.552, 2.053, 0.830, 0.595), 0.0115),
    PublishedRow("B", FILTERED, Columns(3.344, 1.968, 3.535, 2.043, 0.551, 0.553), 0.0118),
    PublishedRow("B", OBSERVED, Columns(4.044, 1.969, 11.758, 4.394, 9.105, 2.118), 0.0117),
)
CONFIRMED = (BASELINE, "cascade-feedforward")  # controllers with a target of our own
DRAWN = (BASELINE, "cascade-notch", "cascade-leso-exact")  # Figs 3.8 to 3.11


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce yuan-tracking`."""

    quick: bool = False
    """Finish within a minute: nothing is tuned, the ranking is that of the first gains."""
    tuned: tuple[str, ...] = ()
    """Controllers that are tuned, by their names in `jcontour list`; all when none is given."""


def run(settings: Settings, folder: Path) -> Result:
    """Simulate everything; nothing is written to the folder.

    Raises:
        ValueError: no such controller of flexible axes.
    """
    setup = Setup()
    known = setup.controllers()
    for name in settings.tuned:
        if name not in known:
            raise ValueError(
                f"tuned: there is no controller {name!r} of flexible axes; "
                f"give some of {', '.join(known)}"
            )
    to_tune = () if settings.quick else settings.tuned or tuple(known)
    rows, signals = _all_runs(setup, known, to_tune)
    tables = table_rows(PUBLISHED, rows)
    found = Result(SOURCE, asdict(settings), rows, signals, gap_curve(setup), tables)
    return replace(found, claims=claims(found, CONFIRMED))


class _Tracked(NamedTuple):
    """A controller with its first or its tuned gains, and its signals by task."""

    name: str
    gains: str
    weights: dict[str, Any]
    controller: Controller
    signals: dict[str, Signals]
    family: tuple[FamilyRow, ...]


def _all_runs(
    setup: Setup, known: Sequence[str], to_tune: Sequence[str]
) -> tuple[tuple[RankingRow, ...], dict[str, dict[str, Signals]]]:
    """Rows of the ranking, and the signals of Figs 3.8 to 3.11."""

    def tracked(name: str) -> list[_Tracked]:
        return _tracked(setup, name, name in to_tune, bool(to_tune) and name == BASELINE)

    # compiling takes longer than simulating, and lets other threads go on
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(tracked, known))
    signals = {}
    for name, runs in zip(known, found, strict=True):
        if name in DRAWN:
            signals[name] = _thinned(setup, runs[0].signals)
    rows = [_row(setup, one) for runs in found for one in runs]
    return tuple(rows), signals


def _tracked(setup: Setup, name: str, tune: bool, compared: bool) -> list[_Tracked]:
    """The controller with its first gains, and with tuned ones where it is tuned."""
    design = setup.design(name)
    gains = {"start": design.start}
    if tune:
        gains["tuned"] = tuned_weights(name)
    found = []
    for which, weights in gains.items():
        controller = design.build(weights)
        family = on_the_family(setup, controller) if tune or compared else ()
        signals = setup.signals(controller)
        found.append(_Tracked(name, which, weights, controller, signals, family))
    return found


def _row(setup: Setup, one: _Tracked) -> RankingRow:
    """Row of the ranking; the controller is timed alone, when all others have ended."""
    return RankingRow(
        controller=one.name,
        gains=one.gains,
        weights={key: np.asarray(value).tolist() for key, value in one.weights.items()},
        A=metrics(one.signals["A"]),
        B=metrics(one.signals["B"]),
        family=one.family,
        time_us=1e6 * setup.time_per_sample(one.controller),
    )


def _thinned(setup: Setup, by_task: dict[str, Signals]) -> dict[str, Signals]:
    """Signals at every `KEPT_PERIOD`."""
    every = round(KEPT_PERIOD / setup.machine.model.dt)
    names = [field.name for field in fields(Signals)]
    kept = {}
    for task, signals in by_task.items():
        kept[task] = Signals(**{name: getattr(signals, name)[::every] for name in names})
    return kept
