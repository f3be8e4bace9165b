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
from jaxtyping import Float

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
    return worst_of(*iteration_sizes(law, family, shape, places))


def iteration_sizes(
    law: "LearningLaw",
    family: Iterable[Callable[[Any], Any]],
    shape: tuple[int, int],
    places: Sequence[int] | None = None,
) -> tuple[Float[np.ndarray, "places members W"], Float[np.ndarray, " W"]]:
    """|M| at every place, of every member, at frequencies [rad per sample]; and these.

    A filter behind the law scales it by its own response, so that many filters need it only once.
    As `convergence`.
    """
    places = (shape[0] // 4,) if places is None else tuple(places)
    frequency, members = np.linspace(0, np.pi, FREQUENCIES), list(family)
    if not members or not places:
        raise ValueError("family: there is no machine in it")
    rows = []
    for place in places:
        iteration = law.iteration(frequency, place)
        responses = (frequency_response(one, shape, place, frequency) for one in members)
        rows.append([np.linalg.norm(iteration(one), 2, axis=(1, 2)) for one in responses])
    return np.array(rows), frequency


def worst_of(
    sizes: Float[np.ndarray, "places members W"], frequency: Float[np.ndarray, " W"]
) -> Convergence:
    """Largest size, the first of equal ones; what is not finite is infinite.

    >>> worst_of(np.array([[[0.5, 0.2], [0.1, 0.9]]]), np.array([0.0, np.pi]))
    Convergence(bound=0.9, member=1, frequency=3.141592653589793)
    """
    known = np.where(np.isfinite(sizes), sizes, np.inf)
    _, member, k = np.unravel_index(int(np.argmax(known)), known.shape)
    return Convergence(float(known.max()), int(member), float(frequency[k]))


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
