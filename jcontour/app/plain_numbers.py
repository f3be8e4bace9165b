"""Numbers as the command line takes and prints them: plain digits, feeds, numbers of samples."""

import math
import re
from typing import Annotated

from tyro.constructors import PrimitiveConstructorSpec

PLAIN = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
WHOLE = re.compile(r"[+-]?[0-9]+")
NOT_FINITE = re.compile(r"[+-]?(?:inf|infinity|nan)", re.IGNORECASE)
MM_PER_MIN = 1e-3 / 60  # [m/s]


def feed_words(*speeds: float) -> str:
    """Speeds [m/s] as programs have feeds; one number where all are alike.

    >>> feed_words(0.05, 0.025), feed_words(0.02, 0.02)
    ('3000, 1500 mm/min', '1200 mm/min')
    """
    feeds = [feed_number(speed) for speed in speeds]
    return f"{', '.join(feeds[:1] if len(set(feeds)) == 1 else feeds)} mm/min"


def feed_number(speed: float) -> str:
    """A speed [m/s] in mm/min: five digits, or all before the point where it has more."""
    feed = speed / MM_PER_MIN
    return f"{feed:.0f}" if feed >= 1e5 else f"{feed:.5g}"


def number_in(text: str) -> float:
    """Number that a text is, in plain digits; inf and nan are read as well.

    >>> number_in("-2.5e-3")
    -0.0025

    Python's own `float` also reads `1_0`, blanks and the digits of other scripts.
    """
    if PLAIN.fullmatch(text) or NOT_FINITE.fullmatch(text):
        return float(text)
    raise ValueError(f"needs a number in plain digits, received {text!r}")


def whole_in(text: str) -> int:
    """Whole number that a text is, in plain digits."""
    if WHOLE.fullmatch(text):
        return int(text)
    raise ValueError(f"needs a whole number in plain digits, received {text!r}")


def named_numbers(flag: str, words: str) -> tuple[str, tuple[float, ...]]:
    """Name and numbers of NAME=VALUE or NAME=VALUE,VALUE,... words.

    >>> named_numbers("weights", "gain=2,3.5")
    ('gain', (2.0, 3.5))
    """
    name, _, values = words.partition("=")
    try:
        numbers = tuple(number_in(value) for value in values.split(","))
    except ValueError:
        numbers = (math.nan,)
    if not all(map(math.isfinite, numbers)):
        raise ValueError(
            f"{flag}: needs NAME=VALUE or NAME=VALUE,VALUE,... with finite numbers, "
            f"received {words!r}"
        )
    return name, numbers


class WholePath(int):
    """The word `path` in place of a number of samples: as many as the run has, see `seeing_all`.

    It is no number of samples itself: as one it is zero, which every controller refuses.
    """

    WORD = "path"

    def __repr__(self) -> str:
        return self.WORD

    __str__ = __repr__


Samples = Annotated[
    int,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"INT|{WholePath.WORD}",
        instance_from_str=lambda words: (
            WholePath() if words[0] == WholePath.WORD else whole_in(words[0])
        ),
        is_instance=lambda value: isinstance(value, int),
        str_from_instance=lambda value: [str(value)],
    ),
]
