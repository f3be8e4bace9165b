"""Numbers that are lost (NaN) in a run without having grown before: a fault, not an instability."""

import numpy as np

from jcontour.app.files.checks import LARGEST
from jcontour.app.jobs.replays import Replay, Scenarios, replay
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.simulation.evaluation import stack_plants

SOUGHT = "look for 0 / 0, inf - inf, and roots and logarithms of negative numbers in"
NAN = "is NaN (not a number)"
PLACES = {"output": "the plant", "control": "the controller and in what it measures"}


def lost_at_start(run: TuningRun) -> list[str]:
    """A line where the start of a search meets NaN so, on the smooth machines that it sees."""
    machine, design = run.machine, run.design
    family = stack_plants(machine.smooth_family(design.fed))
    smooth = run.scenarios._replace(family=family)
    return lost_numbers(replay(design.build(design.start), smooth), smooth)[:1]


def lost_numbers(found: Replay, scenarios: Scenarios) -> list[str]:
    """One line where the nominal plant's run on a contour meets NaN out of moderate numbers.

    The output is known before the control of the same sample.
    """
    lines = []
    for k, job in enumerate(scenarios.jobs):
        signals = {"output": found.output[k, 0], "control": found.control[k, 0]}
        first = {name: _first_lost(rows) for name, rows in signals.items()}
        name = min(first, key=lambda name: first[name])
        sample = first[name]
        before = [np.abs(rows[:sample]) for rows in signals.values()]
        if sample == len(signals[name]) or any(np.any(rows > LARGEST) for rows in before):
            continue
        lines.append(
            f"the {name} {NAN} from sample {sample} ({job.name}, {scenarios.plants[0]}): "
            f"{SOUGHT} {PLACES[name]}"
        )
    return lines


def _first_lost(rows: np.ndarray) -> int:
    """Index of the first row with a NaN; their number where there is none."""
    return int(np.argmax(np.append(np.isnan(rows).any(axis=-1), True)))
