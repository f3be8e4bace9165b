"""Iterative learning: the same run lap after lap, each with a correction learned from the last.

    c_0 = 0,   e_j = error of lap j with the correction c_j,   c_{j+1} = law(c_j, e_j)
Here c shifts the reference of any controller, so that the law composes with all of them. Laps start
alike; only the noise differs. All of it is one scan: derivatives flow through the laps.

P-type learning (Arimoto, Kawamura & Miyazaki 1984) has a Q filter:

    c_{j+1} = Q [c_j + gain e_j(k + lead)],     Q = ((q + 2 + 1/q) / 4)^n
Q has no phase: its response is cos(w/2)^(2n). It forgets what is too fast to be learned. With the
response T of the positions to the correction, the laps converge, and every lap is better than the
last in the RMS of the correction's distance from its limit, where for every frequency

    |Q (1 - gain exp(jw lead) T)| < 1.
"""

import abc
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from jcontour.controller import Controller, Plan, Wrapper, checked_gain
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import simulate

GROWN = 2.0  # times the error of the first lap: learning that leads there has diverged
NO_ERROR = 1e-10  # [m]: a tenth of a nanometre is no error that a machine can make
PAYS = 1.05  # ratio of errors from which on a lap is better than another

Errors = ArrayLike | Sequence  # of numbers, one for each lap


class Lap(NamedTuple):
    """One lap, or all of them with a leading axis."""

    correction: Float[Array, "*laps T m"]  # c that it was run with
    error: Float[Array, "*laps T m"]  # reference less what is measured; what the law learns from
    output: Float[Array, "*laps T m"]  # tool point
    control: Float[Array, "*laps T p"]  # of the controller


class LearningLaw(eqx.Module):
    """Rule by which a correction follows from the last one and its error, linear in both."""

    @abc.abstractmethod
    def update(
        self, correction: Float[Array, "T m"], error: Float[Array, "T m"]
    ) -> Float[Array, "T m"]:
        """Correction of the next lap."""


class Learned(Wrapper):
    """A controller whose reference is shifted by a learned correction.

    Beyond the lap the last sample of the correction holds. The score is taken against the reference
    itself.

    >>> from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
    >>> from jcontour.motion.point_to_point import thesis_task_a
    >>> from jcontour.sensors import motors
    >>> cascade = Cascade(CascadeGains(30.0, 55.67, 0.04), motors(1), dt=1e-3)
    >>> task = thesis_task_a()
    >>> shifted = Learned(cascade, 1e-6 * jnp.ones((task.steps, 1)))
    >>> moved = shifted.prepare(task).position - cascade.prepare(task).position
    >>> bool(jnp.allclose(moved, 1e-6, atol=1e-15))
    True

    Args:
        controller: the wrapped controller.
        correction: c (T, m) [m].
    """

    controller: Controller
    correction: Float[Array, "T m"]

    def prepare(self, reference: Reference) -> Plan:
        """Plan of the wrapped controller along the shifted reference.

        Raises:
            ValueError: the correction is of a lap of another length or number of axes.
        """
        axes = reference.position.shape[-1]
        if self.correction.shape != (reference.steps, axes):
            raise ValueError(
                f"correction: needs the shape ({reference.steps}, {axes}) of the lap, "
                f"received {self.correction.shape}"
            )
        beyond = jnp.repeat(self.correction[-1:], reference.preview, axis=0)
        shift = jnp.concatenate([self.correction, beyond])
        moved = eqx.tree_at(lambda r: r.position, reference, reference.position + shift)
        return self.controller.prepare(moved)


# (correction, number of the lap) -> the lap
RunLap = Callable[[Float[Array, "T m"], Int[Array, ""]], Lap]


def laps_of(
    plant: Callable[[Int[Array, ""]], Plant],
    controller: Controller,
    reference: Reference,
    positions: Callable[[Any], Float[Array, " m"]],
) -> RunLap:
    """Laps of a closed loop.

    Args:
        plant: the machine of each lap, by its number: noise may differ.
        controller: what the correction is put in front of.
        reference: of one lap.
        positions: of the axes, from a measurement.
    """

    def run(correction, lap):
        rollout = simulate(plant(lap), Learned(controller, correction), reference)
        measured = jax.vmap(positions)(rollout.measurement)
        error = reference.position[: reference.steps] - measured
        return Lap(correction, error, rollout.output, rollout.control)

    return run


def learn(
    run: RunLap, law: LearningLaw, laps: int, start: Float[Array, "T m"]
) -> tuple[Lap, Float[Array, "T m"]]:
    """All laps, and the correction that the last one leads to.

    A plant y(k+1) = (y(k) + u(k)) / 2 that learns a ramp:

    >>> from jcontour.controllers.learning.laps import PType
    >>> def run(u, lap):
    ...     _, y = jax.lax.scan(lambda y, u: ((y + u) / 2,) * 2, jnp.zeros(1), u)
    ...     return Lap(u, jnp.arange(1.0, 5.0)[:, None] - y, y, u)
    >>> history, _ = learn(run, PType(gain=1.0), 4, jnp.zeros((4, 1)))
    >>> jnp.abs(history.error).max(axis=(1, 2)).tolist()
    [4.0, 0.9375, 0.25, 0.125]

    Args:
        run: runs one lap.
        law: the rule.
        laps: how many laps.
        start: correction of the first lap (T, m).

    Raises:
        ValueError: there is no lap.
    """
    if laps < 1:
        raise ValueError(f"laps: needs at least one, received {laps}")

    def lap(correction, number):
        outcome = run(correction, number)
        return law.update(correction, outcome.error), outcome

    last, rows = jax.lax.scan(lap, start, jnp.arange(laps))
    return rows, last


def diverged_lap(errors: Errors) -> int | None:
    """First lap, counted from one, whose error is twice that of the first or not finite.

    Errors are in metres; that of the first lap counts as at least a tenth of a nanometre.

    >>> diverged_lap([1.0, 1.5, 2.5, 4.0]), diverged_lap([1.0, 0.5])
    (3, None)

    Raises:
        ValueError: there is no lap.
    """
    values = _of_laps(errors)
    lost = ~np.isfinite(values)
    if not lost[0]:
        lost |= values > GROWN * max(values[0], NO_ERROR)
    return int(np.argmax(lost)) + 1 if lost.any() else None


def paying_laps(errors: Errors) -> int | None:
    """First lap, counted from one, that no later lap betters by a twentieth; None without a lap.

    Laps whose error is not finite do not count.

    >>> paying_laps([8.0, 4.0, 2.0, 1.0, 0.99, 1.01])
    4

    Raises:
        ValueError: there is no lap.
    """
    values = _of_laps(errors)
    finite = np.isfinite(values)
    if not finite.any():
        return None
    return int(np.argmax(values <= PAYS * np.min(values[finite]))) + 1


def _of_laps(errors: Errors) -> Float[np.ndarray, " laps"]:
    values = np.asarray(errors, float)
    if values.ndim != 1 or values.size == 0:
        raise ValueError(f"errors: need one number per lap, received shape {values.shape}")
    return values


class PType(LearningLaw):
    """P-type law with a lead and a smoothing filter.

    >>> law = PType(gain=0.5, lead=1, smoothing=1)
    >>> law.update(jnp.zeros((4, 1)), jnp.array([[0.0], [0.0], [2.0], [0.0]]))[:, 0].tolist()
    [0.25, 0.5, 0.25, 0.0]

    Args:
        gain: part of the error that is taken over in a lap.
        lead: samples by which the error is read ahead: the delay of the loop.
        smoothing: n, how often the filter (1/4, 1/2, 1/4) is passed; zero leaves it out.

    Raises:
        ValueError: the gain is negative or not finite, or the lead or the smoothing is negative.
    """

    gain: Float[Array, ""]
    lead: int = eqx.field(static=True)
    smoothing: int = eqx.field(static=True)

    def __init__(self, gain: ArrayLike, lead: int = 0, smoothing: int = 0):
        for name, value in {"lead": lead, "smoothing": smoothing}.items():
            if value != int(value) or value < 0:
                raise ValueError(f"{name}: needs a whole number of at least zero, received {value}")
        self.gain = checked_gain("gain", gain)
        self.lead, self.smoothing = int(lead), int(smoothing)

    def update(
        self, correction: Float[Array, "T m"], error: Float[Array, "T m"]
    ) -> Float[Array, "T m"]:
        """Q [c + gain e(k + lead)]; beyond the end of the lap the error is that of its last sample.

        Raises:
            ValueError: the lead is longer than the lap.
        """
        if self.lead >= error.shape[0]:
            raise ValueError(
                f"lead: {self.lead} samples are more than the lap of {error.shape[0]} has"
            )
        beyond = jnp.repeat(error[-1:], self.lead, axis=0)
        ahead = jnp.concatenate([error[self.lead :], beyond])
        return smoothed(correction + self.gain * ahead, self.smoothing)


def smoothed(signal: Float[Array, "T m"], times: int) -> Float[Array, "T m"]:
    """The signal after (1/4, 1/2, 1/4), passed so often; its ends are held."""
    if times == 0:
        return signal

    def once(x, _):
        held = jnp.concatenate([x[:1], x, x[-1:]])
        return (held[:-2] + 2 * x + held[2:]) / 4, None

    return jax.lax.scan(once, signal, length=times)[0]
