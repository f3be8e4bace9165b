"""Weights that vary in a sweep, as a command line names them: a grid, or a random sample."""

from collections.abc import Mapping, Sequence

from jaxtyping import Array, Float

from jcontour.app.plain_numbers import named_numbers
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

    A random sample lies between the least value and the largest, even in the logarithm.

    Raises:
        ValueError: fewer than zero samples, or a random sample from values that are not all above
            zero.
    """
    if samples < 0:
        raise ValueError(f"samples: needs at least 0, received {samples}")
    if not samples:
        return grid(**varied)
    for name, values in varied.items():
        if min(values) <= 0:
            raise ValueError(
                f"vary: a random sample needs values above zero, for it is even in the logarithm; "
                f"received {min(values):g} for {name}: give a lower end above zero, or a grid "
                "without --samples"
            )
    ends = {name: (min(values), max(values)) for name, values in varied.items()}
    return random_sample(samples, seed, **ends)
