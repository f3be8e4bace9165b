"""Weights that vary in a sweep, as a command line names them: a grid, or a random sample."""

from collections.abc import Mapping, Sequence

from jaxtyping import Array, Float

from experiments.plain_numbers import number_in
from tuning.sweep import grid, random_sample

Listed = dict[str, tuple[float, ...]]


def listed_values(words: Sequence[str]) -> Listed:
    """Values by name of NAME=VALUE,VALUE,... words.

    Raises:
        ValueError: words of another form.
    """
    return dict(map(_listed, words))


def sampled_designs(
    varied: Mapping[str, Sequence[float]], samples: int, seed: int
) -> dict[str, Float[Array, " D"]]:
    """The grid of all values, or so many random designs where `samples` is above zero.

    A random sample lies between the least value above zero and the largest, even in the logarithm.

    Raises:
        ValueError: fewer than zero samples, or values between which nothing can be drawn.
    """
    if samples < 0:
        raise ValueError(f"samples: needs at least 0, received {samples}")
    if not samples:
        return grid(**varied)
    ends = {}
    for name, values in varied.items():
        positive = [value for value in values if value > 0]
        ends[name] = (min(positive, default=0.0), max(values))
    return random_sample(samples, seed, **ends)


def _listed(words: str) -> tuple[str, tuple[float, ...]]:
    name, _, values = words.partition("=")
    try:
        return name, tuple(number_in(value) for value in values.split(","))
    except ValueError:
        raise ValueError(
            f"vary: needs NAME=VALUE,VALUE,... with numbers, received {words!r}"
        ) from None
