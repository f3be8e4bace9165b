"""Does learning converge for a whole family of machines? Told before the first lap.

A correction c_j that is learned with the matrix M at a frequency, c_{j+1} = M c_j + const, comes
closer to its limit in every lap by at least the largest singular value of M,

    |c_{j+1} - c| <= max over frequency of |M| |c_j - c|.
A loop that is the same along the lap has one response; a loop that is not is looked at in several
places, frozen there. The lap is taken as long: what its two ends do is not in the bound. Below one
the laps converge without a rise. At one and above nothing is promised: the laps may rise before
they fall, or diverge.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

if TYPE_CHECKING:
    from jcontour.controllers.learning.laps import LearningLaw

FREQUENCIES = 512  # from zero to the Nyquist frequency


class Convergence(NamedTuple):
    """What is known before the first lap.

    Attributes:
        bound: largest |M| over the family, the places and the frequencies.
        member: which of the family has it.
        frequency: where it is [rad per sample].
    """

    bound: float
    member: int
    frequency: float

    @property
    def assured(self) -> bool:
        """Whether every lap is closer to the limit than the last, for the whole family."""
        return self.bound < 1


def convergence(
    law: "LearningLaw",
    family: Iterable[Callable[[Any], Any]],
    shape: tuple[int, int],
    places: Sequence[int] | None = None,
) -> Convergence:
    """Bound on the ratio from lap to lap over a family of linearised machines.

    Args:
        law: the rule.
        family: each member as a linear function, correction (T, m) to positions (T, m).
        shape: (T, m) of a lap.
        places: samples around which the loops are frozen; the first quarter of the lap when not
            given.

    Raises:
        ValueError: the family is empty, or a place is not within the lap.
    """
    places = (shape[0] // 4,) if places is None else tuple(places)
    frequency = np.linspace(0, np.pi, FREQUENCIES)
    members = list(family)
    worst = Convergence(-1.0, -1, 0.0)
    for place in places:
        iteration = law.iteration(frequency, place)
        for number, member in enumerate(members):
            response = frequency_response(member, shape, place, frequency)
            sizes = np.linalg.norm(iteration(response), 2, axis=(1, 2))
            k = int(np.argmax(np.where(np.isfinite(sizes), sizes, np.inf)))
            if not sizes[k] <= worst.bound:
                bound = float(sizes[k]) if np.isfinite(sizes[k]) else np.inf
                worst = Convergence(bound, number, float(frequency[k]))
    if worst.member < 0:
        raise ValueError("family: there is no machine in it")
    return worst


def frequency_response(
    linear: Callable[[Any], Any], shape: tuple[int, ...], place: int, frequency: np.ndarray
) -> np.ndarray:
    """Response (W, m, m) of a linear function of signals (T, m) around a sample.

    It is the Fourier transform of what an impulse at that sample does, in either direction of time,
    at frequencies (W,) [rad per sample].

    >>> late = lambda c: jnp.roll(c, 2, axis=0)
    >>> found = frequency_response(late, (64, 1), 16, np.array([0.0, np.pi / 2, np.pi]))
    >>> found[:, 0, 0].round(12).tolist()
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
