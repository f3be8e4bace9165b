"""Lines for grbl itself, which are not G-code: its settings and homing ($), its status (?), ~."""

from jcontour.geometry.gcode.language.blocks import COMMENT
from jcontour.geometry.toolpath_rules import ToolpathError, shown

MOST_TOLD = 20  # letters


def sender_word(line: str) -> str | None:
    """What is told of a line that is not G-code; None for G-code.

    >>> sender_word("$32=1"), sender_word("?  ; the status"), sender_word("G1 X1")
    ('$32', '?', None)

    Raises:
        ToolpathError: a jog, which would move the machine.
    """
    begin = line.lstrip()[:1]
    if begin == "$":
        word = "".join(line.split()).upper()
        if word.startswith("$J"):
            raise ToolpathError(f"{shown(line)} is a jog of grbl, which is not simulated")
        return word.split("=")[0][:MOST_TOLD]
    if begin and begin in "?~" and COMMENT.sub(r"\1", line).strip() == begin:
        return begin
    return None
