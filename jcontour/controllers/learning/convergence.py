"""Does learning converge for a whole family of machines? Known before the first lap.

A law and a linear machine make a linear iteration, c_{j+1} = M c_j + const. Where it is the same at
every sample of the lap, with the answer M_k of the next correction to an impulse, k samples apart,

    |c_{j+1} - c| <= max over w of |M(w)| |c_j - c|,    M(w) = sum_k M_k exp(-j w k)
in the middle half of the lap; c is the limit, |M(w)| the largest singular value. What the two ends
of the lap do is not in it. Below one the laps converge without a rise. At one and above they may
rise before they fall, or diverge.

|M(w) v|^2 is a trigonometric polynomial, nonnegative, of degree n. By Riesz's lemma (Ehlich &
Zeller, Mathematische Zeitschrift 86, 1964) its values at N > n even places bound all others:

    max over w of |M(w)| <= max over the places of |M(w)| / cos(pi n / 2N).
An iteration that changes along the lap has no such bound. Its answers to impulses at three places
give an estimate.
"""

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jcontour.analysis.frequency_response import largest_singular

if TYPE_CHECKING:
    from jcontour.controllers.learning.laps import LearningLaw

OVERSAMPLED = 32  # places for each degree: the bound is at most 0.12 % above the maximum
ALIKE = 1e-6  # largest relative difference between two samples of an iteration that are the same
NEGLECTED = 1e-9  # sum of |M_k| at the ends of the answers that is added instead of transformed


class Convergence(NamedTuple):
    """What is known before the first lap."""

    estimate: float  # largest |M| over the family
    member: int  # which of the family has it
    frequency: float  # where it is [rad per sample]
    # whether the iteration is the same at every sample, so that `estimate` is a bound
    invariant: bool

    @property
    def bound(self) -> float:
        """Bound on the ratio from lap to lap; infinite where the iteration changes along it."""
        return self.estimate if self.invariant else np.inf

    @property
    def assured(self) -> bool:
        """Whether every lap is closer to the limit than the last, for the whole family."""
        return self.bound < 1


class Answers(NamedTuple):
    """Answers of the iteration to impulses, and their size over frequency."""

    # |M| at even frequencies from zero to pi, the largest of all places; by member
    sizes: Float[np.ndarray, "members W"]
    degree: int  # n, the largest of all members
    neglected: float  # largest sum of |M_k| that is not in `sizes`
    invariant: bool  # whether the iteration of every member is the same at every sample

    def convergence(self, smoothing: int = 0) -> Convergence:
        """Convergence with the filter of `PType` behind the law; what is not finite is infinite.

        Args:
            smoothing: n of the filter, at most what the answers were made for.
        """
        count = self.sizes.shape[-1] - 1
        frequency = np.pi * np.arange(count + 1) / count
        sizes = self.sizes * np.cos(frequency / 2) ** (2 * smoothing)
        sizes = np.where(np.isfinite(sizes), sizes, np.inf)
        member, k = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        beyond = np.cos(np.pi * (self.degree + 2 * smoothing) / (4 * count))
        largest = float(sizes[member, k] / beyond) + self.neglected
        return Convergence(largest, int(member), float(frequency[k]), self.invariant)


def answers(
    law: "LearningLaw",
    family: Iterable[Callable[[Any], Any]],
    shape: tuple[int, int],
    smoothing: int = 0,
) -> Answers:
    """Answers of a law over a family of linearised machines.

    Args:
        law: the rule.
        family: each member as a linear function, correction (T, m) to positions (T, m).
        shape: (T, m) of a lap.
        smoothing: most that is asked of `Answers.convergence` later.

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
    return Answers(np.array(sizes), degree, neglected, all(same for _, same in members))


def _member(
    law: "LearningLaw", linear: Callable[[Any], Any], shape: tuple[int, int]
) -> tuple[list[Float[np.ndarray, "K m m"]], bool]:
    """Answers of the iteration to impulses, and whether it is the same at every sample.

    It is if it commutes with a shift by one sample. A random signal shows that: one that does not
    is seen with probability one.
    """
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
    """Answer without its ends, and the sum of what these hold."""
    size = np.linalg.norm(kernel, axis=(1, 2))
    needed = (np.cumsum(size) > NEGLECTED / 2) & (np.cumsum(size[::-1])[::-1] > NEGLECTED / 2)
    if not np.isfinite(size).all() or not needed.any():
        return kernel, 0.0
    kept = slice(int(np.argmax(needed)), len(kernel) - int(np.argmax(needed[::-1])))
    return kernel[kept], float(size[: kept.start].sum() + size[kept.stop :].sum())


def frequency_response(
    linear: Callable[[Any], Any], shape: tuple[int, ...], place: int, frequency: np.ndarray
) -> np.ndarray:
    """Response (W, m, m) of a linear function of signals (T, m) around a sample.

    It is the Fourier transform of what an impulse at that sample does, in either direction of time,
    at frequencies (W,) [rad per sample].

    >>> late = lambda c: jnp.roll(c, 2, axis=0)
    >>> response = frequency_response(late, (64, 1), 16, np.array([0.0, np.pi / 2, np.pi]))
    >>> response[:, 0, 0].round(12).tolist()
    [(1+0j), (-1-0j), (1+0j)]

    Raises:
        ValueError: the place is not within the lap.
    """
    steps, axes = shape
    if not 0 <= place < steps:
        raise ValueError(f"places: need to be from 0 to {steps - 1}, received {place}")
    impulses = jnp.zeros((axes, steps, axes)).at[jnp.arange(axes), place, jnp.arange(axes)].set(1.0)
    rows = np.asarray(jax.vmap(linear)(impulses))  # input, time, output
    time = np.arange(steps) - place
    turns = np.exp(-1j * np.asarray(frequency)[:, None] * time)
    return np.einsum("wk,ikj->wji", turns, rows)
