"""Effect of forces on the motor of a flexible axis, substep by substep.

    x+ = R x + U u + sum_i G_i F_i,   x = (x_m, v_m, x_e, v_e)
is one Runge-Kutta substep of `plants.flexible_axis` with a force F_i of its own on the motor at
every stage: friction and cogging do not stay the same over a substep. A substep in which the motor
sticks is one whose friction balances the other forces at every stage.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.linear.plant import LinearPlant
from jcontour.plants.flexible_axis.axis import FlexibleAxis
from jcontour.plants.flexible_axis.models import rate_matrices

STAGES = 4


class SampleMaps(NamedTuple):
    """Maps from the begin of a sample to the end of each of its S substeps.

    Attributes:
        free: of the state, R^s, s = 1 ... S.
        driven: of the control.
        forced: of the forces of all stages (substep, state, force), none after its own stage.
        pushed: of one force that is held over a substep, at its end.
    """

    free: Float[np.ndarray, "S 4 4"]
    driven: Float[np.ndarray, "S 4"]
    forced: Float[np.ndarray, "S 4 f"]
    pushed: Float[np.ndarray, "4"]

    def later(self, effect: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4 S"]:
        """Effect at the end of every substep as it is at the end of the sample, a column each."""
        onward = [*self.free[-2::-1], np.eye(4)]
        return np.stack([R @ effect for R in onward], axis=1)


def sample_maps(axis: FlexibleAxis) -> SampleMaps:
    """Maps of one axis without dry friction and cogging.

    Raises:
        ValueError: there are several axes.
    """
    if axis.parameters.axes != 1:
        raise ValueError(f"axis: needs one, received {axis.parameters.axes}")
    R, U, G = _substep(axis)
    count = axis.substeps
    free, driven = [R], [U]
    forced = np.zeros((count, 4, STAGES * count))
    forced[0, :, :STAGES] = G
    for s in range(1, count):
        free.append(R @ free[-1])
        driven.append(R @ driven[-1] + U)
        forced[s] = R @ forced[s - 1]
        forced[s, :, STAGES * s : STAGES * (s + 1)] = G
    return SampleMaps(np.stack(free), np.stack(driven), forced, G.sum(axis=1))


def frictionless(axis: FlexibleAxis) -> LinearPlant:
    """The axis without dry friction and cogging, as its substeps integrate it."""
    maps = sample_maps(axis)
    tool = np.array([[0.0, 0.0, 1.0, 0.0]])
    return LinearPlant(maps.free[-1], maps.driven[-1][:, None], tool, axis.dt)


def _substep(axis: FlexibleAxis) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """R, U and G of the module."""
    A, B = (np.asarray(matrix)[0] for matrix in rate_matrices(axis.parameters))
    h, push = (
        axis.dt / axis.substeps,
        np.array([0.0, 1 / float(axis.parameters.motor_mass[0]), 0, 0]),
    )

    def step(x, u, forces):
        slopes = []
        for i, share in enumerate((0.0, 0.5, 0.5, 1.0)):
            at = x + share * h * slopes[-1] if slopes else x
            slopes.append(A @ at + B[:, 0] * u + push * forces[i])
        k1, k2, k3, k4 = slopes
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    zero, none = np.zeros(4), np.zeros(STAGES)
    R = np.stack([step(unit, 0.0, none) for unit in np.eye(4)], axis=1)
    G = np.stack([step(zero, 0.0, unit) for unit in np.eye(STAGES)], axis=1)
    return R, step(zero, 1.0, none), G
