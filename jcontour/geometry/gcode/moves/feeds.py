"""Feeds that the word F asks for: a length per minute (G94), or one over minutes (G93)."""

from jcontour.geometry.toolpath_rules import FASTEST, MM, SHORTEST, SLOWEST, ToolpathError

MM_PER_MIN = MM / 60.0  # [m/s]
RANGE = f"{SLOWEST / MM_PER_MIN:g} to {FASTEST / MM_PER_MIN:.0f} mm/min"


def feed_per_minute(word: float, unit: float, given: float | None) -> float:
    """Feed [m/s] of F in units per minute, 0 for F0.

    >>> feed_per_minute(600.0, 1e-3, None)
    0.01

    Args:
        word: number of F.
        unit: in force [m].
        given: that replaces every programmed one [m/s], which no machine needs to run then; None
            without one.

    Raises:
        ToolpathError: it is below zero, too slow or too fast.
    """
    feed = word * unit / 60.0
    if given is not None and word >= 0 and not SLOWEST <= feed <= FASTEST:
        return given
    if not (feed == 0 or SLOWEST <= feed <= FASTEST):
        received = f"F{word:.10g}" if unit == MM else f"F{word:.10g} in inches"
        raise ToolpathError(
            f"the feed needs to be {RANGE}, received {received}; --feed-mm-per-min gives another"
        )
    return feed


def inverse_time_feed(word: float, length: float) -> float:
    """Feed [m/s] of a move of a length [m] in inverse time.

    Raises:
        ToolpathError: it is too slow or too fast.
    """
    feed = length * word / 60.0
    if length >= SHORTEST and not SLOWEST <= feed <= FASTEST:
        raise ToolpathError(
            f"the feed needs to be {RANGE}; "
            f"F{word:g} in inverse time makes it {feed / MM_PER_MIN:.3g}"
        )
    return feed
