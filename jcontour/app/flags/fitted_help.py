"""Help that fits the terminal.

tyro wraps what stands in its boxes; the lines of usage and of the description are printed as they
are. They are broken here, on their way out. What may be relied on: tyro prints help to
`sys.stdout`, and asks that for its encoding and whether it is a terminal.
"""

import io
import re
import shutil
import sys
from collections.abc import Sequence
from contextlib import nullcontext, redirect_stdout
from typing import Any, TextIO

import tyro

from jcontour.app.flags.rules import RULES

ASKED = {"-h", "--help"}
STYLE = re.compile(r"\033\[[\d;]*m")  # takes no place on the terminal
PIECES = re.compile(r"\s*(?:[^\s,]+,?|,)")  # words with the space before them
USAGE = "    "  # before what goes on of it


def read(kind: Any, arguments: Sequence[str], prog: str, description: str) -> Any:
    """Flags from the command line; help is printed as wide as the terminal.

    Raises:
        SystemExit: help was asked for, or a flag is wrong.
    """
    asked = ASKED & set(arguments)
    with redirect_stdout(_Fitted(sys.stdout)) if asked else nullcontext():
        return tyro.cli(
            kind, prog=prog, description=description, args=list(arguments), registry=RULES
        )


def fitted(line: str, width: int) -> str:
    r"""A line broken between words, and behind commas within one.

    >>> fitted("usage: jcontour {tune,simulate}", 24)
    'usage: jcontour {tune,\n    simulate}'
    """
    if _size(line) <= width:
        return line
    lines = [""]
    indent = USAGE if STYLE.sub("", line).startswith("usage:") else ""
    for piece in PIECES.findall(line):
        if lines != [""] and _size(lines[-1] + piece) > width:
            lines.append(indent)
            piece = piece.lstrip()
        lines[-1] += piece
    return "\n".join(lines)


def _size(text: str) -> int:
    return len(STYLE.sub("", text))


class _Fitted(io.TextIOBase):
    """Lines on their way to a terminal, none wider than it."""

    encoding = ""  # hides the one of the parent, which cannot be set

    def __init__(self, out: TextIO):
        self._out, self.encoding = out, out.encoding

    def isatty(self) -> bool:
        return self._out.isatty()

    def write(self, text: str) -> int:
        width = shutil.get_terminal_size().columns
        self._out.write("\n".join(fitted(line, width) for line in text.split("\n")))
        return len(text)

    def flush(self) -> None:
        self._out.flush()
