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

Whether learning converges for a whole family of machines is known before the first lap. A law and a
linear machine make a linear iteration, c_{j+1} = M c_j + const. Where it is the same at every
sample of the lap, with the response M_k of the next correction to an impulse, k samples apart,

    |c_{j+1} - c| <= max over w of |M(w)| |c_j - c|,    M(w) = sum_k M_k exp(-j w k)
in the middle half of the lap; c is the limit, |M(w)| the largest singular value. What the two ends
of the lap do is not in it. Below one the laps converge without a rise. At one and above they may
rise before they fall, or diverge.

|M(w) v|^2 is a trigonometric polynomial, nonnegative, of degree n. By Riesz's lemma (Ehlich &
Zeller, Mathematische Zeitschrift 86, 1964) its values at N > n even places bound all others:

    max over w of |M(w)| <= max over the places of |M(w)| / cos(pi n / 2N).
An iteration that changes along the lap has no such bound. Its impulse responses at three places
give an estimate.
"""

import abc
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from jcontour._arrays import whole_number
from jcontour.analysis.frequency_response import largest_singular
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
    diverged = ~np.isfinite(values)
    if not diverged[0]:
        diverged |= values > GROWN * max(values[0], NO_ERROR)
    return int(np.argmax(diverged)) + 1 if diverged.any() else None


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
        self.gain, self.lead = checked_gain("gain", gain), whole_number("lead", lead)
        self.smoothing = whole_number("smoothing", smoothing)

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


OVERSAMPLED = 32  # places for each degree: the bound is at most 0.12 % above the maximum
ALIKE = 1e-6  # largest relative difference between two samples of an iteration that are the same
NEGLECTED = 1e-9  # sum of |M_k| at the ends of the responses that is added instead of transformed


class Convergence(NamedTuple):
    """What is known before the first lap."""

    estimate: float  # largest |M| over the family
    member: int  # which of the family has it
    frequency: float  # where it is [rad per sample]
    # whether the iteration is the same at every sample, so that `estimate` is a bound
    invariant: bool


class ImpulseResponses(NamedTuple):
    """Impulse responses of the iteration, and their size over frequency."""

    # |M| at even frequencies from zero to pi, the largest of all places; by member
    sizes: Float[np.ndarray, "members W"]
    degree: int  # n, the largest of all members
    neglected: float  # largest sum of |M_k| that is not in `sizes`
    invariant: bool  # whether the iteration of every member is the same at every sample

    def convergence(self, smoothing: int = 0) -> Convergence:
        """Convergence with the filter of `PType` behind the law; what is not finite is infinite.

        Args:
            smoothing: n of the filter, at most what they were made for.
        """
        count = self.sizes.shape[-1] - 1
        frequency = np.pi * np.arange(count + 1) / count
        sizes = self.sizes * np.cos(frequency / 2) ** (2 * smoothing)
        sizes = np.where(np.isfinite(sizes), sizes, np.inf)
        member, k = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        beyond = np.cos(np.pi * (self.degree + 2 * smoothing) / (4 * count))
        largest = float(sizes[member, k] / beyond) + self.neglected
        return Convergence(largest, int(member), float(frequency[k]), self.invariant)


def impulse_responses(
    law: LearningLaw,
    family: Iterable[Callable[[Any], Any]],
    shape: tuple[int, int],
    smoothing: int = 0,
) -> ImpulseResponses:
    """Impulse responses of a law over a family of linearised machines.

    Args:
        law: the rule.
        family: each member as a linear function, correction (T, m) to positions (T, m).
        shape: (T, m) of a lap.
        smoothing: most that is asked of `ImpulseResponses.convergence` later.

    Raises:
        ValueError: the family is empty, or the lap has fewer than eight samples.
    """
    if shape[0] < 8:
        raise ValueError(f"shape: needs a lap of at least eight samples, received {shape[0]}")
    members = [_member(law, linear, shape) for linear in family]
    if not members:
        raise ValueError("family: there is no machine in it")
    short = [[_shortened(kernel) for kernel in kernels] for kernels, _ in members]
    degree = max(len(kernel) for kernels in short for kernel, _ in kernels) - 1
    places = OVERSAMPLED * 2 ** int(np.ceil(np.log2(degree + 2 * smoothing + 1)))
    sizes = [
        np.max([largest_singular(np.fft.rfft(one, places, axis=0)) for one, _ in kernels], axis=0)
        for kernels in short
    ]
    neglected = max(rest for kernels in short for _, rest in kernels)
    return ImpulseResponses(np.array(sizes), degree, neglected, all(same for _, same in members))


def _member(
    law: LearningLaw, linear: Callable[[Any], Any], shape: tuple[int, int]
) -> tuple[list[Float[np.ndarray, "K m m"]], bool]:
    """Impulse responses of the iteration, and whether it is the same at every sample."""
    # it is if it commutes with a shift by one sample; a random signal shows it with probability one
    steps, axes = shape
    places = [steps // 4, steps // 2, 3 * steps // 4]
    middle = slice(places[0], places[-1])
    wave = np.random.default_rng(0).standard_normal((places[-1] - places[0], axes))
    signals = np.zeros((3 * axes + 2, steps, axes))
    for k, place in enumerate(places):
        signals[k * axes : (k + 1) * axes, place] = np.eye(axes)
    signals[-2, middle] = wave
    signals[-1, places[0] + 1 : places[-1] + 1] = wave

    def iteration(correction):
        return law.update(correction, -linear(correction))

    errors = np.asarray(jax.vmap(iteration)(jax.device_put(signals)))
    here, shifted = errors[-2, places[0] : places[-1] - 1], errors[-1, places[0] + 1 : places[-1]]
    with np.errstate(invalid="ignore"):  # what is not finite is not the same
        same = bool(np.linalg.norm(shifted - here) <= ALIKE * np.linalg.norm(here))
    first, half, last = np.moveaxis(errors[:-2].reshape(3, axes, steps, axes), 1, -1)
    if not same:
        return [first, half, last], False
    # all pairs of samples in the middle: later ones from its first, earlier ones from its last
    return [np.concatenate([last[places[0] + 1 : places[-1]], first[middle]])], True


def _shortened(kernel: Float[np.ndarray, "K m m"]) -> tuple[Float[np.ndarray, "k m m"], float]:
    """Response without its ends, and the sum of what these hold."""
    size = np.linalg.norm(kernel, axis=(1, 2))
    needed = (np.cumsum(size) > NEGLECTED / 2) & (np.cumsum(size[::-1])[::-1] > NEGLECTED / 2)
    if not np.isfinite(size).all() or not needed.any():
        return kernel, 0.0
    kept = slice(int(np.argmax(needed)), len(kernel) - int(np.argmax(needed[::-1])))
    return kernel[kept], float(size[: kept.start].sum() + size[kept.stop :].sum())
