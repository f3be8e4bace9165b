"""Standstill on counting encoders: what the rounding of positions makes the controls do.

The tool is held between two counts, where the reading is always wrong by a part of one. A loop that
integrates hunts for the position that it cannot read.
"""

import numpy as np

from jcontour.app.files.results.tuned_result import Standstill
from jcontour.app.machines.machine import Fed, Machine
from jcontour.controller import Controller
from jcontour.geometry.contours import line
from jcontour.motion.references import Reference, along
from jcontour.simulation.evaluation import evaluate, stack_plants, stack_references

BETWEEN = (0.15, 0.3, 0.45)  # counts from the nearest one to the place that is held
SAMPLES = 1500  # that it is held
SETTLED = 500  # samples that do not count


def standstill(controller: Controller, machine: Machine, fed: Fed) -> Standstill | None:
    """Worst of places and family; None where nothing is counted."""
    if machine.resolution is None or fed == "state":
        return None
    places = [_held(machine, part * machine.resolution, controller.preview) for part in BETWEEN]
    family = stack_plants(machine.frictionless.true_family(fed))
    metrics = evaluate(family, controller, stack_references(places), (SETTLED, SAMPLES))
    return Standstill(
        rms_control=float(np.max(metrics.rms_control)),
        rms_increment=float(np.max(metrics.rms_increment)),
    )


def _held(machine: Machine, offset: float | np.ndarray, preview: int) -> Reference:
    place = np.broadcast_to(offset, len(machine.axes))
    path = line(place, place + 1e-3)
    return along(path, np.zeros(SAMPLES), machine.model.dt, preview, at_rest=True)
