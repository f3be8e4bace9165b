"""Certificates of a twisting gantry: linear along its own run, and a remainder that is closed.

    z(k+1) = M(k) z(k) + E(k) w(k) + rho(k),   |rho(k)| <= r(k)
z is the deviation from the undisturbed run, M and E its Jacobians. rho is what the equation of
motion bends (`gantry_bending`). The sensors bend likewise, which is an error of the measurement,
and so does the tool. All these act like more disturbances: they make the tube wider, and the tube
makes them larger. They have closed where what was assumed is at least what follows.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jcontour.analysis.frozen_loops import unlimited
from jcontour.controller import Controller
from jcontour.guarantees.certificates import (
    ROUNDING,
    Certificate,
    check_box,
    check_limits,
    error_bounds,
)
from jcontour.guarantees.distance import frames_along
from jcontour.guarantees.disturbed_loop import (
    Box,
    DisturbedLoop,
    check_linear_controller,
    check_planless,
    loop_along,
)
from jcontour.guarantees.gains.gained_loops import received_rows
from jcontour.guarantees.gantry.gantry_bending import STATES, Bending, Sensors
from jcontour.guarantees.gantry.intervals import ReachesZero
from jcontour.guarantees.peak_bounds import peak_bounds
from jcontour.motion.references import Reference
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.wrappers.encoders import Sensed
from jcontour.simulation.closed_loop import check_run, prepared, simulate

ROUNDS = 8
MARGIN = 1.05  # of a guess that is checked


class NonlinearCertificate(NamedTuple):
    """Largest errors of a nonlinear machine.

    Attributes:
        whole: as of a linear loop; its attacks are those of the loop along the run.
        remainder: part of every spread that the bending adds [m].
    """

    whole: Certificate
    remainder: Float[np.ndarray, "T m"]


def gantry_certificate(
    gantry: Gantry, sensors: Sensors, controller: Controller, reference: Reference, box: Box
) -> NonlinearCertificate:
    """Largest contour errors of a gantry for all that the box allows.

    Args:
        gantry: the machine; its currents are neither late nor limited.
        sensors: its measurement as a function of the state, for instance `MotorEncoders`.
        controller: linear in memory and measurement.
        reference: the run; its scored samples count.
        box: of forces on the motors and errors of the measurement.

    Raises:
        NotAffine: the controller is not linear, or may reach its limit.
        ValueError: as `simulate`; the box does not fit; or the remainder does not close.
    """
    plant = Sensed(gantry, sensors)
    check_run(plant, controller, reference)
    check_planless(controller)
    free = unlimited(controller)
    plan = prepared(free, reference)
    run = simulate(plant, free, reference)
    first = jax.tree.map(lambda leaf: leaf[0], (plan, run.memory, run.measurement))
    check_linear_controller(free, *first)
    loop = eqx.filter_jit(loop_along)(plant, free, plan, reference)
    check_box(loop, box)
    tubes = _Tubes(gantry, sensors, loop, np.asarray(run.state), box)
    states, bent = tubes.closed()
    frames = frames_along(reference, loop.output)
    rows = frames.basis @ np.asarray(loop.C)
    both = np.concatenate([rows, loop.K], axis=1)
    direct = np.zeros((*both.shape[:2], box.size.size))
    direct[:, rows.shape[1] :, box.force.size :] = loop.D
    linear = peak_bounds(loop, both, box.size, direct).bound
    m = rows.shape[1]
    more = tubes.under(both, bent, m)
    curved = tubes.bending.of(gantry.output, states)
    remainder = more[:, :m] + np.einsum("tsm,tm->ts", np.abs(frames.basis), curved)
    spread = linear[:, :m] + remainder
    control = np.abs(np.asarray(loop.control)) + linear[:, m:] + more[:, m:]
    check_limits(plant, controller, control, box)
    bound, nominal = error_bounds(reference, loop.output, frames, spread)
    scored = np.asarray(reference.mask)[: reference.steps]
    control = (1 + ROUNDING) * control
    whole = Certificate(bound, nominal, control, rows, spread, scored, loop, box)
    return NonlinearCertificate(whole, remainder)


class _Tubes:
    """Tubes of state and control around an undisturbed run, and the remainder that they make."""

    def __init__(
        self, plant: Gantry, sensors: Sensors, loop: DisturbedLoop, run: np.ndarray, box: Box
    ):
        self.sensors = sensors
        self.loop, self.run, self.control = loop, run, np.asarray(loop.control)
        self.bending = Bending(plant, run, self.control)
        T, N = loop.M.shape[:2]
        self.lift = np.eye(N, STATES)
        unit = np.broadcast_to(self.lift.T, (T, STATES, N))
        self.rows = np.concatenate([unit, loop.K], axis=1)
        direct = np.concatenate([np.zeros((T, STATES, box.size.size)), received_rows(loop)], axis=1)
        self.linear = peak_bounds(loop, self.rows, box.size, direct).bound

    def closed(self) -> tuple[np.ndarray, np.ndarray]:
        """Tube of the states, and the bending of state and measurement that it is made with.

        Raises:
            ValueError: it does not close.
        """
        T, q = self.run.shape[0], self.loop.D.shape[2]
        bent = np.zeros((T, STATES + q))
        for _ in range(ROUNDS):
            tube = self.linear + self.under(self.rows, bent, STATES)
            states, controls = tube[:, :STATES], tube[:, STATES:]
            try:
                needed = self.needed(states, controls)
            except ReachesZero:
                break
            if np.all(needed <= bent):
                return states, bent
            bent = MARGIN * needed
        raise ValueError(
            "box: the remainder does not close, the tube leads to a larger tube for ever; there is "
            "no bound for disturbances as large"
        )

    def needed(self, states: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """Bending of state and measurement in these tubes (T, 6 + q)."""
        measured = self.bending.of(self.sensors, states)
        return np.concatenate([self.bending.remainder(states, controls), measured], axis=1)

    def under(self, rows: np.ndarray, bent: np.ndarray, first: int) -> np.ndarray:
        """Largest signals that bending makes (T, rows); rows from `first` on are controls."""
        if not bent.any():
            return np.zeros(rows.shape[:2])
        (T, r, _), p = rows.shape, self.control.shape[1]
        columns = np.concatenate(
            [np.broadcast_to(self.lift, (T, *self.lift.shape)), self.loop.E[:, :, p:]], axis=2
        )
        direct = np.zeros((T, r, bent.shape[1]))
        direct[:, first:, STATES:] = np.abs(self.loop.D) * bent[:, None, STATES:]
        pushed = self.loop._replace(E=jnp.asarray(columns * bent[:, None]))
        return peak_bounds(pushed, rows, np.ones(bent.shape[1]), direct).bound
