"""Runs of a replay as the contour figures draw them: nominal plant, and the worst of the family."""

from collections.abc import Mapping

import numpy as np

from jcontour.app.jobs.replays import Replay, Scenarios, desired, scored
from jcontour.app.machines.machine import Machine
from jcontour.app.reports.figures.loops.contour_runs import NOMINAL, ContourRuns, DrawnRun

LARGEST = {"rms": "largest RMS", "peak": "largest error"}  # what makes a plant the worst one


def contour_runs(
    replays: Mapping[str, Replay], scenarios: Scenarios, index: int, machine: Machine
) -> ContourRuns:
    """Runs along one contour: a row on the nominal plant, a row on every label's worst plant.

    Of one label alone that is the plant with the largest error, whose place is printed; several are
    compared by their RMS errors.
    """
    by = "peak" if len(replays) == 1 else "rms"
    steps = scenarios.jobs[index].steps
    nominal = tuple(_drawn(label, NOMINAL, one, index, 0, steps) for label, one in replays.items())
    rows = [nominal]
    if len(scenarios.plants) > 1:
        rows.append(
            tuple(
                _worst(label, one, scenarios, index, machine.error, by)
                for label, one in replays.items()
            )
        )
    return ContourRuns(
        name=scenarios.jobs[index].name,
        time=scenarios.references.dt * np.arange(steps),
        scored=scored(scenarios)[index, :steps],
        reference=desired(scenarios)[index, :steps],
        axes=machine.axes,
        control_unit=machine.control_unit,
        rows=tuple(rows),
    )


def worst_plant(replay: Replay, index: int, error: str, by: str) -> int:
    """Plant of the largest error, by one of `LARGEST`; the first that diverges, where one does."""
    values = np.asarray(getattr(replay.metrics, f"{by}_{error}_error"))[index]
    lost = np.asarray(replay.metrics.diverged)[index]
    return int(np.argmax(np.where(lost, np.inf, values)))


def _worst(
    label: str, replay: Replay, scenarios: Scenarios, index: int, error: str, by: str
) -> DrawnRun:
    plant = worst_plant(replay, index, error, by)
    words = f"{LARGEST[by]} ({scenarios.plants[plant]})"
    return _drawn(label, words, replay, index, plant, scenarios.jobs[index].steps)


def _drawn(label: str, words: str, replay: Replay, index: int, plant: int, steps: int) -> DrawnRun:
    return DrawnRun(
        label=label,
        plant=words,
        output=replay.output[index, plant, :steps],
        control=replay.control[index, plant, :steps],
        contour_error=replay.contour_error[index, plant, :steps],
        diverged=bool(np.asarray(replay.metrics.diverged)[index, plant]),
    )
