"""Rules that all toolpath files obey: units, limits, and the error of a file that breaks one."""

MM = 1e-3  # [m]
INCH = 25.4e-3  # [m]
# [m] shorter moves are dropped, nearer end points are the same: a thousandth of the finest word
# that a program holds
SHORTEST = 1e-9
FARTHEST = 100.0  # [m] of any coordinate; a machine that large is not meant
FASTEST = 100.0  # [m/s]
SLOWEST = 1e-6  # [m/s] of a programmed feed: a millimetre in a quarter of an hour
MOST_MOVES = 500_000  # each is a sample at least
NUMBER = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)"  # regular expression of a decimal number


class ToolpathError(ValueError):
    """A toolpath that cannot be traced.

    The message is one line, which begins with the number of the line where there is one.
    """


def shown(text: str, most: int = 40) -> str:
    """Extract of a file for a message: one line, not long."""
    text = text.strip()
    return ascii(text if len(text) <= most else text[: most - 3] + "...")
