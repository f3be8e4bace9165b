"""Flow of a program by O-words: where each subprogram, branch and loop begins, goes on and ends.

    o100 sub ... o100 endsub            o100 call [1] [2]       o100 return [3]
    o101 if [..] ... o101 elseif [..] ... o101 else ... o101 endif
    o102 while [..] ... o102 endwhile   o102 do ... o102 while [..]
    o102 repeat [5] ... o102 endrepeat  o102 break, o102 continue
    O1000 ... M99, called by M98 P1000

Labels are numbers or <names>. Those of branches and loops belong to their subprogram.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from jcontour.geometry.gcode.expressions import Parameters
from jcontour.geometry.gcode.words import read_block
from jcontour.geometry.toolpath_rules import ToolpathError, shown

MAYBE_O_WORD = re.compile(r"\s*(?:\([^)]*\)\s*)*(?:[Nn][\s0-9.]*)?[Oo]")
DEEPEST = 200  # branches, loops and subprograms in others
LOOPS = frozenset({"while", "do", "repeat"})


@dataclass
class Structure:
    """Places of a program, as indices of its lines."""

    # first line of each, by label, and whether M99 ends it
    subprograms: dict[str, tuple[int, bool]] = field(default_factory=dict)
    # next branch of a branch; the end of a loop or a subprogram
    following: dict[int, int] = field(default_factory=dict)
    # first line of the loop that a line ends, leaves or begins again
    beginning: dict[int, int] = field(default_factory=dict)
    ending: dict[int, int] = field(default_factory=dict)  # last line of a branch's whole, of a loop
    # what is wrong with a line, raised when it is carried out
    faults: dict[int, str] = field(default_factory=dict)


def structure(lines: Sequence[str]) -> Structure:
    """Structure of the lines of a program.

    >>> places = structure(["o1 repeat [3]", "G1 X1", "o1 endrepeat"])
    >>> places.ending, places.beginning
    ({0: 2}, {2: 0})
    """
    reader, constant = _Reader(), Parameters()
    for index, line in enumerate(lines):
        if not MAYBE_O_WORD.match(line):
            continue
        try:
            word = read_block(line).flow
        except ToolpathError:
            continue  # raised when the line is carried out
        if word is None or word.keyword == "call":
            continue
        try:
            label = word.label(constant)
        except ToolpathError:
            reader.fault(index, f"{word.keyword}: its O-word needs a number or a name")
            continue
        reader.read(index, word.keyword, label)
    reader.drop_behind(None)
    return reader.places


def label_text(label: str) -> str:
    """Label of an O-word in a message: one line, not long.

    >>> label_text("<a>"), label_text("7")
    ('o<a>', 'o7')
    """
    return f"o{shown(label)[1:-1]}"


@dataclass
class _Open:
    """A branch, loop or subprogram that has begun."""

    keyword: str
    label: str
    index: int
    branches: list[int]


@dataclass
class _Reader:
    """Structure so far, and what has begun; the innermost is last."""

    places: Structure = field(default_factory=Structure)
    open: list[_Open] = field(default_factory=list)

    def fault(self, index: int, text: str) -> None:
        """Mark a line as faulty; the first fault stays."""
        self.places.faults.setdefault(index, text)

    def drop_behind(self, last: _Open | None) -> None:
        """End what has begun, and mark as faulty what began inside it and never ended."""
        while self.open and (left := self.open.pop()) is not last:
            self.fault(left.index, f"{label_text(left.label)} {left.keyword} has no end")

    def read(self, index: int, keyword: str, label: str) -> None:
        """Read an O-word."""
        places, name = self.places, label_text(label)
        if keyword in ("", "sub"):
            self._begin_subprogram(index, keyword, label)
        elif keyword == "endsub":
            begun = (
                one for one in reversed(self.open) if (one.keyword, one.label) == ("sub", label)
            )
            sub = next(begun, None)
            if sub is None:
                self.fault(index, f"{name} endsub without {name} sub")
                return
            self.drop_behind(sub)
            places.following[sub.index] = index
            places.beginning[index] = sub.index
        elif keyword in ("endwhile", "endrepeat") or (
            keyword == "while" and self._innermost(label, {"do"})
        ):
            kind = {"endwhile": "while", "endrepeat": "repeat"}.get(keyword, "do")
            loop = self._innermost(label, {kind})
            if loop is None:
                self.fault(index, f"the end of a loop without {name} {kind}")
                return
            self.drop_behind(loop)
            places.ending[loop.index] = index
            places.beginning[index] = loop.index
        elif keyword in LOOPS or keyword == "if":
            self._begin(index, keyword, label)
        elif keyword in ("break", "continue"):
            loop = self._innermost(label, LOOPS)
            if loop is None:
                self.fault(index, f"{name} {keyword} outside a loop of that label")
            else:
                places.beginning[index] = loop.index
        elif keyword in ("elseif", "else", "endif"):
            self._branch(index, keyword, label)

    def _innermost(self, label: str, keywords: Collection[str]) -> _Open | None:
        """What has begun last under a label, if it is one of these, in this subprogram."""
        for begun in reversed(self.open):
            if begun.keyword == "sub":
                return None
            if begun.label == label:
                return begun if begun.keyword in keywords else None
        return None

    def _begin(self, index: int, keyword: str, label: str) -> None:
        if len(self.open) == DEEPEST:
            self.fault(index, f"{label_text(label)} {keyword} is more than {DEEPEST} deep")
        else:
            self.open.append(_Open(keyword, label, index, [index]))

    def _begin_subprogram(self, index: int, keyword: str, label: str) -> None:
        if keyword == "sub":
            around = next((one for one in reversed(self.open) if one.keyword == "sub"), None)
            if around is not None:  # those around it have the fault already
                inside = f"begins inside {label_text(around.label)}"
                self.fault(around.index, f"subprogram {label_text(label)} {inside}")
            self._begin(index, keyword, label)
            if label in self.places.subprograms:
                self.fault(index, f"subprogram {label_text(label)} is there twice")
        self.places.subprograms.setdefault(label, (index, keyword == ""))

    def _branch(self, index: int, keyword: str, label: str) -> None:
        begun = self._innermost(label, {"if", "else"} if keyword == "endif" else {"if"})
        if begun is None:
            self.fault(index, f"{label_text(label)} {keyword} without {label_text(label)} if")
            return
        self.places.following[begun.branches[-1]] = index
        begun.branches.append(index)
        if keyword == "else":
            begun.keyword = "else"
        if keyword == "endif":
            self.drop_behind(begun)
            for branch in begun.branches:
                self.places.ending[branch] = index
