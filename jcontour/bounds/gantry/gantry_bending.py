"""Bending of a twisting gantry: its largest difference from its Jacobians over a tube of states.

    z(k+1) = f(z*(k)) + M(k) z(k) + B(k) v(k) + rho(k),   |rho(k)| <= r(k)
z and v are deviations from a run of the machine, M and B its Jacobians there. With J, H the first
and second derivatives of the rates over all states that the tube allows, and d the deviation at a
Runge-Kutta stage,

    tau_i = 1/2 d_i' |H| d_i + h a_i |J| tau_(i-1)        of the rate at stage i
    rho of a substep = h/6 (tau_1 + 2 tau_2 + 2 tau_3 + tau_4)
J and H are intervals that contain all values, not samples (`second_derivatives`).
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.bounds.gantry.second_derivatives import Enclosure, enclosures
from jcontour.plants.friction import runge_kutta
from jcontour.plants.gantry.gantry import EquationOfMotion, Gantry

Sensors = Callable[[Float[Array, "6"]], Float[Array, " r"]]
STATES = 6
SHARES = (0.0, 0.5, 0.5, 1.0)  # of a substep, that the stages lie ahead
WEIGHTS = np.array([1.0, 2.0, 2.0, 1.0]) / 6
ROUNDS = 8
MARGIN = 1.05  # of a guess that is checked


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


class Bending:
    """Bounds of the bending along a run of the machine, for tubes of any size around it.

    Args:
        plant: the machine; its currents are neither late nor limited.
        run: states (T, 6).
        control: currents (T, 3).
    """

    def __init__(
        self, plant: Gantry, run: Float[np.ndarray, "T 6"], control: Float[np.ndarray, "T 3"]
    ):
        self.run, self.control = run, control
        self.h, self.count = plant.dt / plant.substeps, plant.substeps
        self.rates = partial(_rates, EquationOfMotion.of(plant.parameters))
        found = jax.jit(jax.vmap(partial(_inside, self.rates, self.h, self.count)))
        self.inside = _Inside(*map(np.asarray, found(run, control)))

    def of(self, function: Sensors, states: Float[np.ndarray, "T 6"]) -> Float[np.ndarray, "T r"]:
        """Largest difference of a function of the state from its slope, in a tube of states.

        Raises:
            ReachesZero: the function divides by what may be zero.
        """
        found = enclosures(function, self.run - states, self.run + states)
        return np.stack([_quadratic(one, states) for one in found], axis=1) / 2

    def remainder(
        self, states: Float[np.ndarray, "T 6"], controls: Float[np.ndarray, "T 3"]
    ) -> Float[np.ndarray, "T 6"]:
        """Largest effect of bending on the state in one sample, from tubes at its begin.

        The box of all stages is guessed and checked.

        Args:
            states: largest deviation of every state at the begin of the sample.
            controls: largest deviation of the currents, disturbances among them.

        Raises:
            ValueError: the tube within a sample does not close.
            ReachesZero: a mass may be zero in it.
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
