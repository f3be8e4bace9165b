"""Group codes of a DXF file: pairs of lines, a number that says what the next line is."""

import math
import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from jcontour.geometry.toolpath_rules import ToolpathError, shown

NUMBER = re.compile(r"\s*[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eEdD][+-]?[0-9]+)?\s*")
CODE = re.compile(r"-?[0-9]{1,5}")
COMMENT = 999
BINARY = "AutoCAD Binary DXF"

Point = tuple[float, float, float]


class Tag(NamedTuple):
    """A group code and its value, on a line of the file."""

    code: int
    value: str
    line: int

    def number(self) -> float:
        """Value as a number.

        Raises:
            ToolpathError: it is none, or too large for one.
        """
        number = math.inf
        if NUMBER.fullmatch(self.value):
            number = float(self.value.replace("D", "E").replace("d", "e"))
        if not math.isfinite(number):
            raise ToolpathError(f"line {self.line}: needs a number, received {shown(self.value)}")
        return number


class Entity(NamedTuple):
    """What begins with a group code 0: a line, a section, a vertex.

    Attributes:
        kind: as LINE.
        line: of the file.
        tags: its group codes, in order.
    """

    kind: str
    line: int
    tags: Sequence[Tag]

    def text(self, code: int, default: str = "") -> str:
        """First value of a group code."""
        return next((tag.value for tag in self.tags if tag.code == code), default)

    def number(self, code: int, default: float | None = None) -> float:
        """First value of a group code as a number.

        Raises:
            ToolpathError: it is no number, or it is missing and has no default.
        """
        for tag in self.tags:
            if tag.code == code:
                return tag.number()
        if default is None:
            raise ToolpathError(f"line {self.line}: {self.kind} without group code {code}")
        return default

    def flags(self, code: int = 70) -> int:
        """Bits of a group code, 0 where it is missing.

        Raises:
            ToolpathError: it is no number.
        """
        return int(min(max(self.number(code, 0.0), -1e9), 1e9))

    def numbers(self, code: int) -> list[float]:
        """All values of a group code.

        Raises:
            ToolpathError: one is no number.
        """
        return [tag.number() for tag in self.tags if tag.code == code]

    def point(self, code: int, default: Point | None = None) -> Point:
        """First point of the group codes `code`, +10 and +20; its z is 0 where it is missing.

        Raises:
            ToolpathError: no numbers, or they are missing and have no default.
        """
        if default is not None and all(tag.code != code for tag in self.tags):
            return default
        return self.number(code), self.number(code + 10), self.number(code + 20, 0.0)

    def points(self, code: int) -> list[Point]:
        """All points of the group codes `code`, +10 and +20.

        Raises:
            ToolpathError: no numbers, or x without y.
        """
        found: list[list[float]] = []
        for tag in self.tags:
            if tag.code == code:
                found.append([tag.number(), 0.0, 0.0])
            elif tag.code in (code + 10, code + 20) and found:
                found[-1][(tag.code - code) // 10] = tag.number()
        return [(x, y, z) for x, y, z in found]


def entities(lines: Sequence[str]) -> Iterator[Entity]:
    """Entities of a file, sections and tables among them, up to EOF.

    Raises:
        ToolpathError: "line 12: ..." for a group code that is no number, or a file that is binary,
            cut off or no DXF.
    """
    if lines and lines[0].startswith(BINARY):
        raise ToolpathError("line 1: a binary DXF; save it as text (ASCII DXF)")
    kind, begun, tags = "", 0, []
    for tag in _tags(lines):
        if tag.code == 0:
            if kind:
                yield Entity(kind, begun, tags)
            kind, begun, tags = tag.value.strip().upper(), tag.line, []
            if kind == "EOF":
                return
        elif kind:
            tags.append(tag)
        elif tag.code != COMMENT:
            raise ToolpathError(f"line {tag.line}: not a DXF file, which begins with 0 and SECTION")
    raise ToolpathError(
        f"line {len(lines)}: the file is cut off: there is no EOF"
        if kind
        else "not a DXF file: it is empty"
    )


def _tags(lines: Sequence[str]) -> Iterator[Tag]:
    for i in range(0, len(lines) - 1, 2):
        code = lines[i].strip()
        if not CODE.fullmatch(code):
            if i == 0:
                raise ToolpathError("line 1: not a DXF file, which begins with 0 and SECTION")
            if not any(line.strip() for line in lines[i:]):
                return
            raise ToolpathError(f"line {i + 1}: needs a group code, received {shown(lines[i])}")
        yield Tag(int(code), lines[i + 1], i + 2)
