"""Flow of a program by O-words: where each subprogram, branch and loop begins, goes on and ends.

    o100 sub ... o100 endsub            o100 call [1] [2]       o100 return [3]
    o101 if [..] ... o101 elseif [..] ... o101 else ... o101 endif
    o102 while [..] ... o102 endwhile   o102 do ... o102 while [..]
    o102 repeat [5] ... o102 endrepeat  o102 break, o102 continue
    O1000 ... M99, called by M98 P1000

Labels are numbers or <names>. Those of branches and loops belong to their subprogram.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from jcontour.geometry.gcode._expressions import Parameters
from jcontour.geometry.gcode._words import read_block
from jcontour.geometry.toolpath_rules import ToolpathError, shown

MAYBE_O_WORD = re.compile(r"\s*(?:\([^)]*\)\s*)*(?:[Nn][\s0-9.]*)?[Oo]")
DEEPEST = 200  # branches, loops and subprograms in others
BEGINNING = frozenset({"sub", "if", "while", "do", "repeat"})
LOOPS = ("while", "do", "repeat")
INSIDE = {  # what each goes on with, leaves or ends
    "endsub": ("sub",),
    "elseif": ("if",),
    "else": ("if",),
    "endif": ("if", "else"),
    "endwhile": ("while",),
    "endrepeat": ("repeat",),
    "while": ("do",),
    "break": LOOPS,
    "continue": LOOPS,
}


@dataclass
class _Open:
    """A branch, loop or subprogram that has begun."""

    keyword: str
    label: str
    branches: list[int]  # first line, and those of its other branches


class Structure:
    """Places of a program, as indices of its lines.

    >>> places = Structure(["o1 repeat [3]", "G1 X1", "o1 endrepeat"])
    >>> places.ending, places.beginning
    ({0: 2}, {2: 0})

    Attributes:
        subprograms: first line of each, by label.
        following: next branch of a branch, the end of a subprogram.
        beginning: first line of the loop that a line ends, leaves or begins again.
        ending: last line of a branch's whole, of a loop.
        faults: what is wrong with a line, raised when it is carried out.
    """

    def __init__(self, lines: Sequence[str]) -> None:
        self.subprograms: dict[str, int] = {}
        self.following: dict[int, int] = {}
        self.beginning: dict[int, int] = {}
        self.ending: dict[int, int] = {}
        self.faults: dict[int, str] = {}
        self._open: list[_Open] = []  # the innermost is last
        constant = Parameters()
        for index, line in enumerate(lines):
            if not MAYBE_O_WORD.match(line):
                continue
            try:
                word = read_block(line).flow
            except ToolpathError:
                continue  # raised when the line is carried out
            if word is None or word.keyword in ("call", "return"):
                continue
            try:
                self._read(index, word.keyword, word.label_in(constant))
            except ToolpathError:
                self._fault(index, f"{word.keyword}: its O-word needs a number or a name")
        self._end_up_to(None)

    def _read(self, index: int, keyword: str, label: str) -> None:
        name = label_text(label)
        numbered = keyword in ("", "sub")
        first = self.subprograms.setdefault(label, index) if numbered else index
        begun = self._innermost(label, INSIDE.get(keyword, ()))
        if keyword in BEGINNING and begun is None:
            if keyword == "sub":
                around = next((one for one in reversed(self._open) if one.keyword == "sub"), None)
                if around is not None:  # those around it have the fault already
                    inside = f"begins inside {label_text(around.label)}"
                    self._fault(around.branches[0], f"subprogram {name} {inside}")
            if len(self._open) == DEEPEST:
                self._fault(index, f"{name} {keyword} is more than {DEEPEST} deep")
            else:
                self._open.append(_Open(keyword, label, [index]))
            if keyword == "sub" and first != index:
                self._fault(index, f"subprogram {name} is there twice")
        elif begun is not None:
            self._go_on(index, keyword, begun)
        elif keyword in ("break", "continue"):
            self._fault(index, f"{name} {keyword} outside a loop of that label")
        elif keyword:
            self._fault(index, f"{name} {keyword} without {name} {INSIDE[keyword][0]}")

    def _go_on(self, index: int, keyword: str, begun: _Open) -> None:
        """Read a line that goes on with, leaves or ends what has begun."""
        first = begun.branches[0]
        if keyword not in ("break", "continue", "elseif", "else"):
            self._end_up_to(begun)
        if keyword in ("elseif", "else", "endif"):
            self.following[begun.branches[-1]] = index
            begun.branches.append(index)
            begun.keyword = "else" if keyword == "else" else begun.keyword
            if keyword == "endif":
                self.ending |= dict.fromkeys(begun.branches, index)
            return
        self.beginning[index] = first
        if keyword == "endsub":
            self.following[first] = index
        elif keyword not in ("break", "continue"):
            self.ending[first] = index

    def _innermost(self, label: str, keywords: Sequence[str]) -> _Open | None:
        """What has begun last under a label, if it is one of these, in this subprogram."""
        for begun in reversed(self._open):
            if begun.keyword == "sub" or (begun.label == label and keywords != ("sub",)):
                return begun if begun.label == label and begun.keyword in keywords else None
        return None

    def _end_up_to(self, last: _Open | None) -> None:
        """End what has begun, and mark as faulty what began inside it and never ended."""
        while self._open and (left := self._open.pop()) is not last:
            fault = f"{label_text(left.label)} {left.keyword} has no end"
            self._fault(left.branches[0], fault)

    def _fault(self, index: int, text: str) -> None:
        """Mark a line as faulty; the first fault stays."""
        self.faults.setdefault(index, text)


def label_text(label: str) -> str:
    """Label of an O-word in a message: one line, not long.

    >>> label_text("<a>"), label_text("7")
    ('o<a>', 'o7')
    """
    return f"o{shown(label)[1:-1]}"
