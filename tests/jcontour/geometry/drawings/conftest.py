"""Drawings written in a line: entities as `LINE 10=0 20=0 11=3 21=4`."""

from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jcontour.geometry.reading import read_drawing

DATA = Path(__file__).parents[3] / "data" / "drawings"
FEED = 0.05  # [m/s]


MARKS = {
    "LINE": "AcDbLine",
    "CIRCLE": "AcDbCircle",
    "ARC": "AcDbCircle",
    "ELLIPSE": "AcDbEllipse",
    "LWPOLYLINE": "AcDbPolyline",
    "POLYLINE": "AcDb2dPolyline",
    "VERTEX": "AcDbVertex",
    "SPLINE": "AcDbSpline",
    "INSERT": "AcDbBlockReference",
    "BLOCK": "AcDbBlockBegin",
    "ENDBLK": "AcDbBlockEnd",
    "POINT": "AcDbPoint",
    "TEXT": "AcDbText",
    "MTEXT": "AcDbMText",
}
OF_ALL = ("8", "60", "67")  # group codes that every entity has
HANDLES = count(0x100)


def tags(entity: str) -> str:
    kind, *words = entity.split()
    pairs = [word.split("=", 1) for word in words]
    if kind in MARKS:
        pairs = [
            ("5", f"{next(HANDLES):X}"),
            ("100", "AcDbEntity"),
            *(pair for pair in pairs if pair[0] in OF_ALL),
            ("100", MARKS[kind]),
            *(pair for pair in pairs if pair[0] not in OF_ALL),
        ]
    return f"0\n{kind}\n" + "".join(f"{code}\n{value}\n" for code, value in pairs)


def dxf(entities, unit=4, blocks=(), layers=()) -> str:
    """Text of a DXF file; the unit is a number of $INSUNITS, None for a file that does not say."""
    header = "" if unit is None else f"9\n$INSUNITS\n70\n{unit}\n"
    table = ["TABLE 2=LAYER", *layers, "ENDTAB"] if layers else []
    sections = {
        "HEADER": f"9\n$ACADVER\n1\nAC1015\n{header}",
        "TABLES": "".join(map(tags, table)),
        "BLOCKS": "".join(map(tags, blocks)),
        "ENTITIES": "".join(map(tags, entities)),
    }
    text = "".join(
        f"0\nSECTION\n2\n{name}\n{body}0\nENDSEC\n" for name, body in sections.items() if body
    )
    return f"{text}0\nEOF\n"


@pytest.fixture
def drawn(tmp_path, traced):
    """Write drawings, read them, and look at what was read [mm]."""

    def read(text, unit=None, gap=10e-6, suffix=".dxf"):
        path = tmp_path / f"drawing{suffix}"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        toolpath = read_drawing(path, FEED, unit, gap)
        traced.assert_valid(toolpath)
        return toolpath

    def read_dxf(*entities, unit=4, given=None, gap=10e-6, **sections):
        return read(dxf(entities, unit, **sections), given, gap)

    def cut(toolpath, count=9):
        """Points of all pieces that are cut, (n, 2)."""
        return traced.points(toolpath, np.linspace(0, 1, count))[~toolpath.rapid].reshape(-1, 2)

    def length(toolpath):
        return traced.lengths(toolpath)[~toolpath.rapid].sum()

    return SimpleNamespace(
        read=read, dxf=read_dxf, text=dxf, cut=cut, length=length, DATA=DATA, FEED=FEED
    )
