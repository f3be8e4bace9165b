"""Algorithm 1 of chapter 4 on the rigid axis: the whole mass on the motor, without its link.

In error coordinates, e(k+1) = A e(k) + B u(k) + E w(k), within the printed tolerance, the relaxed
speed and the printed current. On the printed axis with its link the algorithm ends empty, as no
controller keeps the tolerance.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.spatial import HalfspaceIntersection

from experiments.papers.panels import Curve, Panel
from jcontour.app.reports.figures.axes import CYCLE, OTHER
from jcontour.linear.transformations import zoh
from jcontour.plants.flexible_axis.axis import thesis_axis
from jcontour.sets.disturbed_model import DisturbedModel
from jcontour.sets.invariant_polytopes import box, control_invariant

PERIOD = 8e-3  # [s]: rows grow with every step
TOLERANCE, SPEED, CURRENT = 4.5e-3, 0.25, 9.0  # [m], [m/s], [A]
DISTURBANCE = 5e-3  # [m/s], largest w in a sample
MARGIN = 1e-2  # rho, over the tolerance and the speed


@dataclass(frozen=True)
class InvariantSetRun:
    """The set that Algorithm 1 ends with."""

    steps: int
    rows: int
    corners: Float[np.ndarray, "c 2"]  # error [m] and its speed [m/s], around the set


@cache
def algorithm_1() -> InvariantSetRun | None:
    """Run of the algorithm; None where it ends empty."""
    axis, scale = thesis_axis(), np.array([TOLERANCE, SPEED])
    mass = float(axis.motor_mass[0] + axis.tool_mass[0])
    viscous, force = float(axis.friction.viscous[0]), float(axis.force_constant[0])
    A, B = (
        np.asarray(one)
        for one in zoh([[0.0, 1.0], [0.0, -viscous / mass]], [[0.0], [force / mass]], PERIOD)
    )
    scaled = A * scale / scale[:, None], B / scale[:, None], np.array([0.0, DISTURBANCE]) / scale
    found = control_invariant(
        DisturbedModel.of(*scaled), box([1.0, 1.0]), np.array([CURRENT]), MARGIN
    )
    if found is None:
        return None
    H, h = found.polytope
    corners = HalfspaceIntersection(np.column_stack([H, -h]), np.zeros(2)).intersections
    around = np.argsort(np.arctan2(corners[:, 1], corners[:, 0]))
    return InvariantSetRun(found.steps, len(h), corners[np.append(around, around[0])] * scale)


def panel(run: InvariantSetRun) -> Panel:
    """The set within the box of tolerance and speed."""
    error, speed = run.corners.T
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * [TOLERANCE, SPEED]
    curves = [
        Curve(1e3 * square[:, 0], square[:, 1], "limits", {"color": OTHER, "linestyle": "--"}),
        Curve(1e3 * error, speed, "robust control invariant set", {"color": CYCLE[0]}),
    ]
    title = f"Algorithm 1 on the rigid axis: {run.rows} rows after {run.steps} steps"
    return Panel(title, "error [mm]", "speed of the error [m/s]", curves)
