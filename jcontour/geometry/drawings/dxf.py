"""Drawings in DXF, text or binary, of any version, as `ezdxf` reads them.

    taken      LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE and POLYLINE with bulges, SPLINE, and INSERT
               of blocks, in blocks too, in arrays, with any scale; in model space, seen from above
    left out   all other kinds, as TEXT, DIMENSION, HATCH and POINT; paper space; what is invisible,
               or on a layer that is off, frozen or never plotted (DEFPOINTS); blocks in other
               files; the clipping of blocks. They are counted by layer. A block on a frozen layer
               is left out as a whole; on one that is off, what it has on other layers is seen, as
               in AutoCAD
    unit       $INSUNITS, or the one that is given; it is asked for where neither says

Line types and widths mean nothing here: the tool follows the middle of each line.
"""

import io
import logging
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any

from jcontour.geometry.drawings import dxf_curves
from jcontour.geometry.drawings.drawing import Drawing, at_line
from jcontour.geometry.toolpath_rules import INCH, MM, MOST_MOVES, ToolpathError, shown
from jcontour.geometry.toolpath_text import lines_of, read_program

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document
    from ezdxf.entities.dxfgfx import DXFGraphic
    from ezdxf.math import Matrix44

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
BINARY = "AutoCAD Binary DXF"
UNIT = "$INSUNITS"  # ezdxf takes metres where a file does not say
# ahead of a file that states no version, but has the marks of R13 and later
VERSION = "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n0\nENDSEC\n"
MARK = "AcDbEntity"
END = re.compile(r"\n\s*0\s*\n\s*EOF\s*(\n|$)")
NEVER_PLOTTED = "DEFPOINTS"
DEEPEST = 32  # blocks in blocks
MOST_CELLS = 10_000  # of an array of blocks: more take longer than ten seconds


def read_dxf(path: str | PathLike[str], unit: float | None = None) -> Drawing:
    """Drawing of a DXF file.

    Args:
        path: of the file.
        unit: of the drawing [m], whatever the file says; None for the file's own.

    Raises:
        ToolpathError: the file or an entity cannot be read; a file without a unit where none is
            given.
    """
    text = read_program(path)
    document = _document(path, text)
    unit = unit or _unit(document.header.get(UNIT, 0) if UNIT in text else 0)
    from ezdxf.math import Matrix44

    reader = _Reader(document, _entity_lines(text))
    reader.draw(document.modelspace(), Matrix44.scale(unit), "0", 0)
    for layout in document.layouts:
        if not layout.is_modelspace:
            for entity in layout:
                reader.leave_out(entity, _stated(entity, "layer", "0"), "in paper space")
    return reader.drawing


def _document(path: str | PathLike[str], text: str) -> "Document":
    """Content of a file; one with faults that move no point is mended.

    Raises:
        ToolpathError: no DXF, a file that is cut off, or numbers that cannot be read.
    """
    # it warns of handles, which move nothing, and as it is imported of a cache of fonts
    logging.getLogger("ezdxf").setLevel(logging.CRITICAL)
    # imported here: it takes longer than the rest of the library
    from ezdxf import recover
    from ezdxf.filemanagement import read, readfile

    if not text.strip():
        raise ToolpathError("not a DXF file: it is empty")
    try:
        if text.startswith(BINARY):
            return readfile(str(path))
        stated = MARK not in text or "HEADER" in text
        return read(io.StringIO(text if stated else VERSION + text, newline=None))
    except Exception as error:  # of any kind, for a file that is anything
        fault = shown(str(error), 200)[1:-1]
    refusal = ToolpathError(f"the DXF file cannot be read: {fault}")
    if text.startswith(BINARY):
        raise refusal
    if not re.match(r"\s*(0|999)\s*\n", text):
        raise ToolpathError("line 1: not a DXF file, which begins with 0 and SECTION")
    if not END.search(text):
        raise ToolpathError("the file is cut off: there is no EOF")
    try:
        document, auditor = recover.read(io.BytesIO(text.encode("utf-8", "replace")))
    except Exception:
        raise refusal from None
    if auditor.errors:
        raise refusal
    return document


def _unit(code: int) -> float:
    """Unit of the drawing [m] by its header."""
    if not code:
        raise ToolpathError(
            f"the drawing does not say its unit ({UNIT}): give it, as --drawing-unit mm"
        )
    if code not in UNITS:
        raise ToolpathError(
            f"a drawing in unit {code} of {UNIT}: give another one, as --drawing-unit mm"
        )
    return UNITS[code]


def _stated(entity: "DXFGraphic", name: str, default: Any) -> Any:
    """Attribute of an entity of any kind, known to ezdxf or not."""
    return entity.dxf.get(name, default) if entity.dxf.is_supported(name) else default


def _entity_lines(text: str) -> dict[str, int]:
    """Lines of a text file at which entities begin, by their handles."""
    lines, begun, found = lines_of(text), 0, {}
    for i in range(0, len(lines) - 1, 2):
        code = lines[i].strip()
        if code == "0":
            begun = i + 2
        elif code == "5":
            found.setdefault(lines[i + 1].strip().upper(), begun)
    return found


@dataclass
class _Reader:
    document: "Document"
    lines: Mapping[str, int]
    drawing: Drawing = field(default_factory=Drawing)
    visited: int = 0

    def __post_init__(self):
        layers = list(self.document.layers)
        self.off = {layer.dxf.name.upper() for layer in layers if layer.is_off()}
        self.frozen = {layer.dxf.name.upper() for layer in layers if layer.is_frozen()}

    def draw(
        self, members: Iterable["DXFGraphic"], place: "Matrix44", layer: str, depth: int
    ) -> None:
        """Draw entities of the drawing, or of a block on a layer."""
        for entity in members:
            self.visited += 1
            line = self.lines.get(entity.dxf.get("handle", ""), 0)
            if self.visited > MOST_MOVES:
                raise ToolpathError(f"{at_line(line)}more than {MOST_MOVES} entities")
            own = _stated(entity, "layer", "0")
            own = layer if own == "0" else own
            reason = self._hidden(entity, own)
            if reason:
                self.leave_out(entity, own, reason)
            elif entity.dxftype() == "INSERT":
                self._insert(entity, place, own, depth, line)
            else:
                segments = dxf_curves.segments(entity, place, line)
                if segments is None:
                    self.leave_out(entity, own)
                else:
                    self.drawing.add(segments, line)

    def _insert(self, insert: Any, place: "Matrix44", layer: str, depth: int, line: int) -> None:
        from ezdxf.xclip import XClip

        block, name = insert.block(), shown(insert.dxf.get("name", ""))
        if block is None:
            raise ToolpathError(f"{at_line(line)}there is no block {name}")
        if block.block.is_xref or block.block.is_xref_overlay:
            self.leave_out(insert, layer, "in another file")
            return
        if depth == DEEPEST:
            raise ToolpathError(f"{at_line(line)}block {name} is in itself, or {DEEPEST} deep")
        if insert.mcount > MOST_CELLS:
            columns, rows = insert.dxf.column_count, insert.dxf.row_count
            raise ToolpathError(f"{at_line(line)}an array of {columns} x {rows} blocks")
        if XClip(insert).is_clipping_enabled:
            self.leave_out(insert, layer, "its clipping")
        for cell in insert.multi_insert() if insert.mcount > 1 else [insert]:
            self.draw(block, cell.matrix44() * place, layer, depth + 1)

    def _hidden(self, entity: "DXFGraphic", layer: str) -> str:
        """Why an entity is not seen; empty where it is."""
        if _stated(entity, "invisible", 0):
            return "invisible"
        layer = layer.upper()
        if layer in self.frozen:
            return "frozen"
        if entity.dxftype() == "INSERT":
            return ""
        if layer in self.off:
            return "off"
        return "never plotted" if layer == NEVER_PLOTTED else ""

    def leave_out(self, entity: "DXFGraphic", layer: str, reason: str = "") -> None:
        """Count an entity that is not taken."""
        kind, reason = shown(entity.dxftype())[1:-1], f", {reason}" if reason else ""
        self.drawing.leave_out(f"{kind} (layer {shown(layer)[1:-1]}{reason})")
