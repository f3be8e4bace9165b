"""Certificates of a twisting gantry: linear along its own run, and a remainder that is closed.

    z(k+1) = M(k) z(k) + E(k) w(k) + rho(k),   |rho(k)| <= r(k)
z is the deviation from the undisturbed run, M and E its Jacobians. rho is what the equation of
motion bends: with J, H the first and second derivatives of the rates over all states that the tube
allows, and d the deviation at a Runge-Kutta stage,
    tau_i = 1/2 d_i' |H| d_i + h a_i |J| tau_(i-1)        of the rate at stage i
    rho of a substep = h/6 (tau_1 + 2 tau_2 + 2 tau_3 + tau_4)
J and H are intervals that contain all values, not samples (`second_derivatives`). The sensors bend
likewise, which is an error of the measurement, and so does the tool. All these act like more
disturbances: they make the tube wider, and the tube makes them larger. They have closed where
what was assumed is at least what follows.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

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
    loop_along,
)
from jcontour.guarantees.gained_loops import received_rows
from jcontour.guarantees.intervals import ReachesZero
from jcontour.guarantees.peak_bounds import peak_bounds
from jcontour.guarantees.second_derivatives import Enclosure, enclosures
from jcontour.motion.references import Reference
from jcontour.plants.gantry.gantry import EquationOfMotion, Gantry
from jcontour.plants.integrators import runge_kutta
from jcontour.plants.wrappers.encoders import Sensed
from jcontour.simulation.closed_loop import check_run, prepared, simulate

Sensors = Callable[[Float[Array, "6"]], Float[Array, " r"]]
STATES = 6
SHARES = (0.0, 0.5, 0.5, 1.0)  # of a substep, that the stages lie ahead
WEIGHTS = np.array([1.0, 2.0, 2.0, 1.0]) / 6
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


class _Inside(NamedTuple):
    """Every sample of the undisturbed run, substep by substep.

    Attributes:
        slopes: of the state after a substep by that before (T, S, 6, 6).
        pushes: of it by the control (T, S, 6, 3).
        low, high: of the states at all stages (T, 6).
    """

    slopes: Any
    pushes: Any
    low: Any
    high: Any


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
    curved = tubes.bend_of(gantry.output, states)
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
        self.h, self.count = plant.dt / plant.substeps, plant.substeps
        motion = EquationOfMotion.of(plant.parameters)
        self.rates = partial(_rates, motion)
        found = jax.jit(jax.vmap(partial(_inside, self.rates, self.h, self.count)))
        self.inside = _Inside(*map(np.asarray, found(run, self.control)))
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
        measured = self.bend_of(self.sensors, states)
        return np.concatenate([self.remainder(states, controls), measured], axis=1)

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

    def bend_of(self, function: Sensors, states: np.ndarray) -> np.ndarray:
        """What a function of the state may differ from its slope (T, r)."""
        found = enclosures(function, self.run - states, self.run + states)
        return np.stack([_quadratic(one, states) for one in found], axis=1) / 2

    def remainder(self, states: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """What bending adds to the state in one sample (T, 6), from tubes at its begin.

        The box of all stages is guessed and checked.
        """
        guess = self._stages(states, controls, None)[1]
        for _ in range(ROUNDS):
            guess = MARGIN * guess
            bends = self._bends(guess, controls)
            r, reached = self._stages(states, controls, bends)
            if np.all(reached <= guess):
                return r
            guess = np.maximum(guess, reached)
        raise ValueError("box: the tube within a sample does not close; disturbances are too large")

    def _bends(self, width: np.ndarray, controls: np.ndarray) -> list[Enclosure]:
        """Enclosures of the rates over all states and controls of every sample."""
        low = np.concatenate([self.inside.low - width, self.control - controls], axis=1)
        high = np.concatenate([self.inside.high + width, self.control + controls], axis=1)
        return enclosures(self.rates, low, high)

    def _stages(
        self, states: np.ndarray, controls: np.ndarray, bends: list[Enclosure] | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Remainder after the sample, and the largest deviation at its stages (T, 6).

        Without enclosures, the deviations of the linear maps alone.
        """
        inside, T = self.inside, len(states)
        slopes, pushes = np.broadcast_to(np.eye(STATES), (T, STATES, STATES)), np.zeros((T, 6, 3))
        rest, reached = np.zeros((T, STATES)), np.zeros((T, STATES))
        left: list[np.ndarray] = []
        for s in range(self.count):
            begin = _times(slopes, states) + _times(pushes, controls) + rest
            if bends is None:
                tau, most = np.zeros_like(begin), begin
            else:
                tau, most = self._substep(begin, controls, bends)
            reached = np.maximum(reached, most)
            R = inside.slopes[:, s]
            left = [R @ one for one in left] + [np.eye(STATES) * tau[:, None]]
            rest = sum(np.abs(one).sum(axis=2) for one in left)
            slopes, pushes = R @ slopes, R @ pushes + inside.pushes[:, s]
        end = _times(slopes, states) + _times(pushes, controls) + rest
        return np.asarray(rest), np.maximum(reached, end)

    def _substep(
        self, begin: np.ndarray, controls: np.ndarray, bends: list[Enclosure]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Remainder of a substep, and the largest deviation at its stages."""
        J = np.stack([one.slope.size for one in bends], axis=1)
        most, tau, found = begin, np.zeros_like(begin), np.zeros_like(begin)
        change = np.zeros_like(begin)
        for share, weight in zip(SHARES, WEIGHTS, strict=True):
            at = begin + share * self.h * change
            both = np.concatenate([at, controls], axis=1)
            curved = np.stack([_quadratic(one, both) for one in bends], axis=1) / 2
            tau = curved + share * self.h * _times(J[:, :, :STATES], tau)
            change = _times(J, both)
            found, most = found + self.h * weight * tau, np.maximum(most, at)
        return found, most


def _times(matrices: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """|A| x of every sample."""
    return np.einsum("tij,tj->ti", np.abs(matrices), sizes)


def _quadratic(one: Enclosure, sizes: np.ndarray) -> np.ndarray:
    """Largest d' H d over |d| <= sizes (T,)."""
    return np.einsum("tij,ti,tj->t", one.bend.size, sizes, sizes)


def _rates(motion: EquationOfMotion, both: Float[Array, "9"]) -> Float[Array, "6"]:
    """Rates of the state under a control."""
    q, v, control = both[:3], both[3:STATES], both[STATES:]
    return jnp.stack([*v, *motion.acceleration(q, v, control)])


def _inside(rates, h: float, count: int, state: Float[Array, "6"], control) -> _Inside:
    """One sample of the run, substep by substep."""

    def of(x, u):
        return rates(jnp.concatenate([x, u]))

    def step(x, u):
        return runge_kutta(lambda x: of(x, u), x, h)

    def substep(x, _):
        k1 = of(x, control)
        k2 = of(x + h / 2 * k1, control)
        k3 = of(x + h / 2 * k2, control)
        after = step(x, control)
        stages = jnp.stack([x, x + h / 2 * k1, x + h / 2 * k2, x + h * k3, after])
        slopes = jax.jacfwd(step, argnums=(0, 1))(x, control)
        return after, (*slopes, stages.min(axis=0), stages.max(axis=0))

    _, (slopes, pushes, low, high) = jax.lax.scan(substep, state, None, length=count)
    return _Inside(slopes, pushes, low.min(axis=0), high.max(axis=0))
