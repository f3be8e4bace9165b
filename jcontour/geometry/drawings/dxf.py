"""Drawings in DXF, as text of any version since R12.

    taken      LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE and POLYLINE with bulges, SPLINE, and INSERT
               of blocks, in blocks too, in arrays, with any scale; in model space, seen from above
    left out   all other kinds, as TEXT, DIMENSION, HATCH and POINT; what is invisible, or on a
               layer that is off, frozen or never plotted (DEFPOINTS); blocks in other files. They
               are told with count and layer. A block on a frozen layer is left out as a whole; on
               one that is off, what it has on other layers is seen, as in AutoCAD
    unit       $INSUNITS, or the one that is given; it is asked for where neither says

Line types and widths mean nothing here: the tool follows the middle of each line.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from os import PathLike

from jcontour.geometry.drawings import dxf_curves
from jcontour.geometry.drawings.drawing import Drawing
from jcontour.geometry.drawings.dxf_placing import Placement, inserted, scaled
from jcontour.geometry.drawings.dxf_tags import Entity, Point, entities
from jcontour.geometry.drawings.segments import Segment
from jcontour.geometry.toolpath_rules import INCH, MM, MOST_MOVES, ToolpathError, shown
from jcontour.geometry.toolpath_text import lines_of, read_program

UNITS = {  # [m] by $INSUNITS
    1: INCH,
    2: 12 * INCH,
    4: MM,
    5: 10 * MM,
    6: 1.0,
    8: 1e-6 * INCH,
    9: 1e-3 * INCH,
    10: 36 * INCH,
    13: 1e-6,
    14: 0.1,
}
CURVES = {
    "LINE": dxf_curves.line,
    "CIRCLE": dxf_curves.circle,
    "ARC": dxf_curves.arc,
    "ELLIPSE": dxf_curves.ellipse,
    "LWPOLYLINE": dxf_curves.light_polyline,
    "SPLINE": dxf_curves.spline,
}
PARTS = ("VERTEX", "ATTRIB", "SEQEND")  # of the entity before
NEVER_PLOTTED = "DEFPOINTS"
FROZEN, OTHER_FILE = 1, 4 | 8  # flags of a layer, and of a block
DEEPEST = 32  # blocks in blocks
MOST_CELLS = 10_000  # of an array of blocks: more take longer than ten seconds


@dataclass
class Block:
    """A block of a file."""

    base: Point
    flags: int
    entities: list[Entity] = field(default_factory=list)


@dataclass
class Contents:
    """What a file holds, of what matters here.

    Attributes:
        unit: [m]; None where the file does not say.
        off: layers that are off; what a block has on other layers is seen.
        frozen: layers that are frozen, with all that a block holds.
        blocks: by name, in capitals.
        entities: of the drawing itself.
    """

    unit: float | None = None
    off: set[str] = field(default_factory=set)
    frozen: set[str] = field(default_factory=set)
    blocks: dict[str, Block] = field(default_factory=dict)
    entities: list[Entity] = field(default_factory=list)


def read_dxf(path: str | PathLike[str], unit: float | None = None) -> Drawing:
    """Drawing of a DXF file.

    Args:
        path: of the file.
        unit: of the drawing [m], whatever the file says; None for the file's own.

    Raises:
        ToolpathError: "line 12: ..." for whatever cannot be read; a file without a unit where none
            is given.
    """
    contents = _contents(lines_of(read_program(path)))
    unit = unit or contents.unit
    if unit is None:
        raise ToolpathError(
            "the drawing does not say its unit ($INSUNITS): give it, as --drawing-unit mm"
        )
    reader = _Reader(contents)
    reader.draw(contents.entities, scaled(unit), "0", 0)
    return reader.drawing


@dataclass
class _Reader:
    contents: Contents
    drawing: Drawing = field(default_factory=Drawing)
    sizes: dict[tuple[str, str], int] = field(default_factory=dict)

    def draw(self, members: Sequence[Entity], place: Placement, layer: str, depth: int) -> None:
        """Draw entities of the drawing, or of a block on a layer."""
        visited = 0
        for i, entity in enumerate(members):
            visited += self._size(entity, layer, depth) if depth == 0 else 0
            if visited > MOST_MOVES:
                raise ToolpathError(f"line {entity.line}: more than {MOST_MOVES} entities")
            if entity.kind in PARTS:
                continue
            own = entity.text(8, "0").strip()
            own = layer if own == "0" else own
            reason = self._hidden(entity, own)
            if reason:
                self._leave_out(entity.kind, own, reason)
            elif entity.kind == "INSERT":
                self._insert(entity, place, own, depth)
            else:
                segments = _segments(entity, members, i, place)
                if segments is None:
                    self._leave_out(entity.kind, own)
                else:
                    self.drawing.add(segments, entity.line)

    def _insert(self, entity: Entity, place: Placement, layer: str, depth: int) -> None:
        name, block = self._block(entity)
        if block.flags & OTHER_FILE:
            self._leave_out("INSERT", layer, "in another file")
            return
        if depth == DEEPEST:
            raise ToolpathError(
                f"line {entity.line}: block {shown(name)} is in itself, or {DEEPEST} deep"
            )
        columns, rows = _cells(entity)
        for cell in range(columns * rows):
            inner = place.of(inserted(entity, block.base, cell % columns, cell // columns))
            self.draw(block.entities, inner, layer, depth + 1)

    def _block(self, entity: Entity) -> tuple[str, Block]:
        """Name of the block that is inserted, and the block."""
        name = entity.text(2).strip()
        block = self.contents.blocks.get(name.upper())
        if block is None:
            raise ToolpathError(f"line {entity.line}: there is no block {shown(name)}")
        return name, block

    def _size(self, entity: Entity, layer: str, depth: int) -> int:
        """Number of entities that one stands for, with those of its blocks.

        Each block is counted once for every layer. One that is too deep is refused when drawn.
        """
        if entity.kind != "INSERT" or depth == DEEPEST:
            return 1
        own = entity.text(8, "0").strip()
        own = layer if own == "0" else own
        if self._hidden(entity, own):
            return 1
        name, block = self._block(entity)
        if block.flags & OTHER_FILE:
            return 1
        if (name, own) not in self.sizes:
            inside = (self._size(one, own, depth + 1) for one in block.entities)
            self.sizes[name, own] = sum(inside)
        columns, rows = _cells(entity)
        return 1 + columns * rows * (1 + self.sizes[name, own])

    def _hidden(self, entity: Entity, layer: str) -> str:
        """Why an entity is not seen; empty where it is."""
        if entity.flags(67):
            return "in paper space"
        if entity.flags(60):
            return "invisible"
        layer = layer.upper()
        if layer in self.contents.frozen:
            return "frozen"
        if entity.kind == "INSERT":
            return ""
        if layer in self.contents.off:
            return "off"
        return "never plotted" if layer == NEVER_PLOTTED else ""

    def _leave_out(self, kind: str, layer: str, reason: str = "") -> None:
        reason = f", {reason}" if reason else ""
        self.drawing.leave_out(f"{shown(kind)[1:-1]} (layer {shown(layer)[1:-1]}{reason})")


def _cells(entity: Entity) -> tuple[int, int]:
    """Columns and rows of an array of blocks."""
    columns, rows = (max(entity.flags(code), 1) for code in (70, 71))
    if columns * rows > MOST_CELLS:
        raise ToolpathError(f"line {entity.line}: an array of {columns} x {rows} blocks")
    return columns, rows


def _segments(
    entity: Entity, members: Sequence[Entity], i: int, place: Placement
) -> list[Segment] | None:
    """Segments of an entity; None where it has none, or is of a kind that is not taken."""
    if entity.kind == "POLYLINE":
        end = i + 1
        while end < len(members) and members[end].kind == "VERTEX":
            end += 1
        return dxf_curves.polyline(entity, members[i + 1 : end], place)
    curve = CURVES.get(entity.kind)
    return None if curve is None else curve(entity, place)


def _contents(lines: Sequence[str]) -> Contents:
    """Sort the entities of a file into its sections."""
    found, section, block = Contents(), "", None
    for entity in entities(lines):
        if entity.kind == "SECTION":
            section = entity.text(2).strip().upper()
            if section == "HEADER":
                found.unit = _unit(entity)
        elif entity.kind == "ENDSEC":
            section = ""
        elif section == "TABLES" and entity.kind == "LAYER":
            name = entity.text(2).strip().upper()
            if entity.flags() & FROZEN:
                found.frozen.add(name)
            elif entity.number(62, 7.0) < 0:
                found.off.add(name)
        elif section == "BLOCKS" and entity.kind == "BLOCK":
            block = Block(entity.point(10, (0.0, 0.0, 0.0)), entity.flags())
            found.blocks[entity.text(2).strip().upper()] = block
        elif section == "BLOCKS" and entity.kind == "ENDBLK":
            block = None
        elif section == "BLOCKS" and block is not None:
            block.entities.append(entity)
        elif section == "ENTITIES":
            found.entities.append(entity)
    return found


def _unit(header: Entity) -> float | None:
    """Unit of the drawing [m] by its header; None where it does not say."""
    for name, value in zip(header.tags, header.tags[1:], strict=False):
        if name.code == 9 and name.value.strip() == "$INSUNITS":
            code = int(min(max(value.number(), 0.0), 1000.0))
            if code and code not in UNITS:
                raise ToolpathError(
                    f"line {value.line}: a drawing in unit {code} of $INSUNITS: "
                    "give another one, as --drawing-unit mm"
                )
            return UNITS.get(code)
    return None
