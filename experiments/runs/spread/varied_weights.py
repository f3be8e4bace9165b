"""Weights that vary in a sweep, as a command line names them: a grid, or a random sample."""

from collections.abc import Mapping, Sequence

from jaxtyping import Array, Float

from experiments.plain_numbers import named_numbers
from tuning.sweep import grid, random_sample

Listed = dict[str, tuple[float, ...]]


def listed_values(words: Sequence[str]) -> Listed:
    """Values by name of NAME=VALUE,VALUE,... words.

    Raises:
        ValueError: words of another form, or a number that is not finite.
    """
    return dict(named_numbers("vary", one) for one in words)


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
