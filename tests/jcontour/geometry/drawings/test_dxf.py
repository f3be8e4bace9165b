"""DXF: closed forms of every kind of curve, blocks, units, layers, and files that are none."""

import random
import re

import ezdxf
import numpy as np
import pytest
from ezdxf.xclip import XClip
from scipy.special import ellipe

from jcontour.geometry.reading import read_drawing
from jcontour.geometry.toolpath_rules import ToolpathError

LINE = "LINE 10=0 20=0 11=3 21=4"
NM = 1e-6  # [mm]
TURN = np.pi / 6


def test_each_piece_tells_its_line_of_the_file(drawn):
    toolpath = read_drawing(drawn.DATA / "plate.dxf", drawn.FEED)
    assert float(toolpath.contour.fit_error) == 0.0  # arcs stay arcs
    assert toolpath.ignored == ("1 TEXT (layer notes)",)
    lines = (drawn.DATA / "plate.dxf").read_text().splitlines()
    kinds = [lines[line - 1] for line in toolpath.line[~toolpath.rapid]]
    assert kinds == [*["LINE", "ARC"] * 4, "CIRCLE", *["LWPOLYLINE"] * 4]


def test_circles_and_arcs(drawn):
    circle = drawn.dxf("CIRCLE 10=1 20=2 40=3")
    assert drawn.length(circle) == pytest.approx(6 * np.pi, rel=1e-14)
    assert circle.contour.rate.shape == (1,) and bool(circle.contour.closed)
    arc = drawn.dxf("ARC 10=1 20=2 40=3 50=350 51=20")
    np.testing.assert_allclose(np.hypot(*(drawn.cut(arc) - [1, 2]).T), 3, rtol=1e-13)
    assert drawn.length(arc) == pytest.approx(3 * np.radians(30), rel=1e-13)
    ends = np.radians([350, 20])
    expected = np.stack([1 + 3 * np.cos(ends), 2 + 3 * np.sin(ends)], axis=1)
    np.testing.assert_allclose(drawn.cut(arc)[[0, -1]], expected, atol=1e-12)
    seen_from_below = drawn.dxf("ARC 10=1 20=2 40=3 50=0 51=90 210=0 220=0 230=-1")
    np.testing.assert_allclose(drawn.cut(seen_from_below)[[0, -1]], [[-4, 2], [-1, 5]], atol=1e-12)


def test_a_leaning_circle_is_seen_as_an_ellipse(drawn):
    """Turned around the y axis by 60 degrees, its x axis is seen half as long."""
    normal = f"210={np.sin(np.pi / 3)} 220=0 230={np.cos(np.pi / 3)}"
    points = drawn.cut(drawn.dxf(f"CIRCLE 10=0 20=0 40=3 {normal}"))
    np.testing.assert_allclose((points[:, 0] / 1.5) ** 2 + (points[:, 1] / 3) ** 2, 1, atol=2e-5)
    assert abs(np.abs(points).max(axis=0) - [1.5, 3]).max() < 10 * NM


def test_a_raised_polyline_that_leans_is_seen_where_its_points_are(drawn):
    """Its own x is the drawing's y, and its own y leans away by 60 degrees from -x."""
    lean, raised = np.pi / 3, 5.0
    points = [(0.0, 0.0), (4.0, 0.0), (4.0, 2.0)]
    up = f"38={raised} 210={np.sin(lean)} 220=0 230={np.cos(lean)}"
    actual = drawn.cut(drawn.dxf(f"LWPOLYLINE {up} 10=0 20=0 10=4 20=0 42=1 10=4 20=2"))
    seen = [(raised * np.sin(lean) - y * np.cos(lean), x) for x, y in points]
    farthest = (raised * np.sin(lean) - np.cos(lean), 5.0)  # of half a circle
    for point in (*seen, farthest):
        assert np.linalg.norm(actual - point, axis=1).min() < 10 * NM


def test_ellipses(drawn):
    whole = drawn.dxf("ELLIPSE 10=1 20=2 11=0 21=6 40=0.5")
    assert drawn.length(whole) == pytest.approx(4 * 6 * ellipe(0.75), abs=10 * NM)
    x, y = (drawn.cut(whole) - [1, 2]).T
    np.testing.assert_allclose(np.hypot(x / 3, y / 6), 1, atol=10 * NM)
    assert bool(whole.contour.closed) and 0 < float(whole.contour.fit_error) <= 1e-8
    quarter = drawn.dxf(f"ELLIPSE 10=1 20=2 11=6 21=0 40=0.5 41=0 42={np.pi / 2}")
    assert drawn.length(quarter) == pytest.approx(6 * ellipe(0.75), abs=10 * NM)
    np.testing.assert_allclose(drawn.cut(quarter)[[0, -1]], [[7, 2], [1, 5]], atol=1e-12)


@pytest.mark.parametrize("bulge", [1.0, -0.3, 2.5, 1e-3])
def test_bulges(drawn, bulge):
    """A bulge is twice the height of the arc over its chord, to the right of it."""
    arc = drawn.dxf(f"LWPOLYLINE 90=2 70=0 10=1 20=1 42={bulge} 10=5 20=1")
    radius = 4 * (1 + bulge**2) / (4 * abs(bulge))
    assert drawn.length(arc) == pytest.approx(radius * 4 * np.arctan(abs(bulge)), rel=1e-12)
    start, middle, end = drawn.cut(arc, 3)
    np.testing.assert_allclose(
        [start, middle, end], [[1, 1], [3, 1 - 2 * bulge], [5, 1]], atol=1e-9
    )


def test_polylines_with_vertices(drawn):
    flat = ["POLYLINE 66=1 70=1", "VERTEX 10=0 20=0", "VERTEX 10=4 20=0 42=1", "VERTEX 10=4 20=4"]
    actual = drawn.dxf(*flat, "SEQEND")
    assert drawn.length(actual) == pytest.approx(4 + 2 * np.pi + 4 * np.sqrt(2))
    frame = ["POLYLINE 66=1 70=4", "VERTEX 10=9 20=9 70=16", *flat[1:], "SEQEND"]
    assert drawn.length(drawn.dxf(*frame)) == pytest.approx(4 + 2 * np.pi)
    space = ["POLYLINE 66=1 70=8", "VERTEX 10=0 20=0 30=7", "VERTEX 10=3 20=4 30=-7", "SEQEND"]
    assert drawn.length(drawn.dxf(*space)) == pytest.approx(5)
    mesh = ["POLYLINE 66=1 70=64", "VERTEX 10=0 20=0", "SEQEND"]
    assert drawn.dxf(LINE, *mesh).ignored == ("1 POLYLINE (layer 0)",)


QUARTER = (
    f"SPLINE 71=2 40=0 40=0 40=0 40=1 40=1 40=1 41=1 41={np.sqrt(0.5)} 41=1 "
    "10=8 20=0 10=8 20=8 10=0 20=8"
)


def test_a_rational_spline_is_a_quarter_of_a_circle(drawn):
    points = drawn.cut(drawn.dxf(QUARTER))
    np.testing.assert_allclose(np.hypot(*points.T), 8, atol=10 * NM)
    assert drawn.length(drawn.dxf(QUARTER)) == pytest.approx(4 * np.pi, abs=10 * NM)


def test_a_uniform_spline_begins_inside_its_control_points(drawn):
    """The uniform cubic is (P0 + 4 P1 + P2) / 6 at its first knot, and ends likewise."""
    control = np.array([[0, 0], [3, 6], [9, 0], [12, 6.0], [15, 3]])
    knots = " ".join(f"40={k}" for k in range(9))
    points = " ".join(f"10={x} 20={y}" for x, y in control)
    actual = drawn.cut(drawn.dxf(f"SPLINE 71=3 {knots} {points}"))
    ends = [(control[i] + 4 * control[i + 1] + control[i + 2]) / 6 for i in (0, 2)]
    np.testing.assert_allclose(actual[[0, -1]], ends, atol=1e-9)


def test_a_spline_through_fit_points(drawn):
    """Four points of a parabola, which the clamped cubic over the chord stays near."""
    fit = np.array([[0, 0], [1, 2], [3, 3], [6, 0.0]])
    points = " ".join(f"11={x} 21={y}" for x, y in fit)
    actual = drawn.cut(drawn.dxf(f"SPLINE 71=3 74=4 12=0 22=1 {points} 13=0 23=-1"), 33)
    for point in fit:
        assert np.linalg.norm(actual - point, axis=1).min() < 10 * NM
    first, last = actual[1] - actual[0], actual[-1] - actual[-2]
    assert first[1] > 0 > last[1] and abs(first[0] / first[1]) < 0.1 > abs(last[0] / last[1])


def test_a_closed_spline_through_points_has_no_corner_where_it_closes(drawn):
    points = " ".join(f"11={x} 21={y}" for x, y in [(0, 0), (3, -1), (4, 2), (1, 3), (0, 0)])
    contour = drawn.dxf(f"SPLINE 70=1 71=3 {points}").contour
    first, last = (contour.tangent(s) for s in (0.0, float(contour.length) * (1 - 1e-9)))
    np.testing.assert_allclose(first, last, atol=1e-6)


BLOCK = ["BLOCK 2=part 10=1 20=1 70=0", "CIRCLE 10=3 20=1 40=2", LINE, "ENDBLK"]


def test_blocks_are_placed_turned_and_scaled(drawn):
    """Scaled by 2 and 3, turned by 30 degrees and shifted: base (1, 1) comes to (10, 20)."""
    insert = "INSERT 2=PART 10=10 20=20 41=2 42=3 50=30"
    actual = drawn.dxf(insert, blocks=BLOCK)
    turned = np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]])
    points = (drawn.cut(actual) - [10, 20]) @ turned.T / [2, 3] + 1
    on_circle = abs(np.hypot(*(points - [3, 1]).T) - 2) < 10 * NM
    on_line = abs(4 * points[:, 0] - 3 * points[:, 1]) < 1e-9
    assert (on_circle | on_line).all() and on_circle.any() and on_line.any()
    assert drawn.length(actual) == pytest.approx(4 * 6 * ellipe(5 / 9) + np.hypot(6, 12), abs=1e-5)


def test_blocks_in_blocks_and_arrays(drawn):
    outer = ["BLOCK 2=outer 10=0 20=0", "INSERT 2=part 10=0 20=0 43=0 42=-1", "ENDBLK"]
    array = "INSERT 2=outer 10=0 20=0 70=3 71=2 44=10 45=20 50=90"
    actual = drawn.dxf(array, blocks=BLOCK + outer)
    assert drawn.length(actual) == pytest.approx(6 * (4 * np.pi + 5))
    low, high = drawn.cut(actual, 33).min(axis=0), drawn.cut(actual, 33).max(axis=0)
    # a cell: x from -1 to 4, y from -3 to 2 once mirrored; turned: x from -2 to 3, y from -1 to 4
    np.testing.assert_allclose([low, high], [[-22, -1], [3, 24]], atol=0.02)


def test_units(drawn):
    for code, mm in ((1, 25.4), (2, 304.8), (4, 1), (5, 10), (6, 1000), (13, 1e-3), (14, 100)):
        assert drawn.length(drawn.dxf(LINE, unit=code)) == pytest.approx(5 * mm)
    assert drawn.length(drawn.dxf(LINE, unit=None, given=25.4e-3)) == pytest.approx(127)
    assert drawn.length(drawn.dxf(LINE, unit=1, given=1e-3)) == pytest.approx(5)
    for unit in (None, 0):
        with pytest.raises(ToolpathError, match=r"does not say its unit .* --drawing-unit mm"):
            drawn.dxf(LINE, unit=unit)


def test_what_is_not_drawn_is_told(drawn):
    layers = ["LAYER 2=off 62=-3 70=0", "LAYER 2=cold 62=7 70=1", "LAYER 2=on 62=7 70=0"]
    unseen = [f"{LINE} 8=OFF", f"{LINE} 8=cold", f"{LINE} 60=1", f"{LINE} 67=1", "POINT 10=1 20=1"]
    actual = drawn.dxf(*unseen, f"{LINE} 8=on", "MTEXT 8=on 1=x", "MTEXT 8=on 1=y", layers=layers)
    assert drawn.length(actual) == pytest.approx(5)
    assert actual.ignored == (
        "1 LINE (layer 0, in paper space)",
        "1 LINE (layer 0, invisible)",
        "1 LINE (layer OFF, off)",
        "1 LINE (layer cold, frozen)",
        "2 MTEXT (layer on)",
        "1 POINT (layer 0)",
    )


@pytest.mark.parametrize(
    ("layer", "length", "told"),
    [
        ("off", 6, ("1 LINE (layer off, off)",)),
        ("DEFPOINTS", 6, ("1 LINE (layer DEFPOINTS, never plotted)",)),
        ("cold", 5, ("1 INSERT (layer cold, frozen)",)),
    ],
)
def test_a_layer_that_is_off_hides_less_of_a_block_than_a_frozen_one(drawn, layer, length, told):
    """The block has a line on layer 0, which is that of its INSERT, and one on its own layer."""
    block = ["BLOCK 2=two", LINE, "LINE 8=seen 10=9 20=0 11=9 21=1", "ENDBLK"]
    layers = ["LAYER 2=off 62=-1", "LAYER 2=cold 62=-1 70=1"]
    actual = drawn.dxf(
        "LINE 10=20 20=0 11=20 21=5",
        f"INSERT 2=two 10=0 20=0 8={layer}",
        blocks=block,
        layers=layers,
    )
    assert drawn.length(actual) == pytest.approx(length)
    assert actual.ignored == told


ITSELF = ["BLOCK 2=part", "INSERT 2=part 10=0 20=0", "ENDBLK"]
TEN = " ".join(["10=1", "20=1"] * 10)
BOMB = [
    line
    for k in range(9)
    for line in (f"BLOCK 2=b{k}", *[f"INSERT 2=b{k + 1} 10=0 20=0"] * 10, "ENDBLK")
]


@pytest.mark.parametrize(
    ("entities", "blocks", "message"),
    [
        ([], [], "no lines or curves are drawn"),
        (["TEXT 1=x"], [], r"no lines or curves are drawn; left out: 1 TEXT \(layer 0\)"),
        (["LINE 10=0 20=0 11=x 21=4"], [], "Invalid floating point values near line: 3[0-9]"),
        (["LINE 10=0 20=0 11=1e9 21=4"], [], "line 20: a point is farther than 100 m away"),
        (["LWPOLYLINE 10=0 20=0 42=1e300 10=1 20=1"], [], "a number is too large"),
        (["LINE 10=0 20=0"], [], "line 20: LINE without end"),
        (["CIRCLE 10=0 20=0 40=0"], [], r"left out: 1 CIRCLE \(layer 0\)"),
        (["ELLIPSE 10=0 20=0 11=0 21=0 40=1"], [], "line 20: ELLIPSE without an axis"),
        (["SPLINE 71=3 10=0 20=0"], [], "line 20: SPLINE of degree 3 with 1 control points and 0"),
        (["SPLINE 71=99 10=0 20=0"], [], "line 20: SPLINE of degree 99"),
        ([QUARTER.replace("40=1 ", "40=-1 ")], [], "line 20: SPLINE with knots that do not rise"),
        ([QUARTER.replace("41=1 10", "41=-1 10")], [], "line 20: SPLINE with weights"),
        (["SPLINE 71=3"], [], "line 20: SPLINE without control points and fit points"),
        (["INSERT 2=none 10=0 20=0"], [], "line 20: there is no block 'none'"),
        (["INSERT 2=part 10=0 20=0"], ITSELF, "line [0-9]+: block 'part' is in itself"),
        (["INSERT 2=b0 10=0 20=0"], BOMB, "line [0-9]+: there is no block 'b9'"),
        (
            ["INSERT 2=p 10=0 20=0 70=9999 71=9999 44=1 45=1"],
            ["BLOCK 2=p", "ENDBLK"],
            "an array of 9999 x 9999",
        ),
        (
            ["INSERT 2=p 10=0 20=0"],
            ["BLOCK 2=p 70=4 1=other.dwg", "ENDBLK"],
            "1 INSERT .layer 0, in another file",
        ),
        ([f"LWPOLYLINE {TEN}"], [], "no lines or curves are drawn"),
    ],
)
def test_bad_entities(drawn, entities, blocks, message):
    with pytest.raises(ToolpathError, match=message) as raised:
        drawn.dxf(*entities, blocks=blocks)
    assert len(str(raised.value).splitlines()) == 1


def test_a_bomb_of_blocks_is_refused(drawn, monkeypatch):
    monkeypatch.setattr("jcontour.geometry.drawings.dxf.MOST_MOVES", 5000)
    blocks = [*BOMB, "BLOCK 2=b9", "ENDBLK"]
    with pytest.raises(ToolpathError, match="more than 5000 entities"):
        drawn.dxf("INSERT 2=b0 10=0 20=0", blocks=blocks)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "not a DXF file: it is empty"),
        (b"G1 X1 F100\nX2\n", "line 1: not a DXF file"),
        (b"AutoCAD Binary DXF\r\n\x1a\0", "the DXF file cannot be read"),
        (b"0\nSECTION\n2\nENTITIES\n0\nLINE\n10\n", "the file is cut off: there is no EOF"),
        (b"0\nSECTION\n2\nENTITIES\nzero\nLINE\n0\nEOF\n", "Invalid group code .* line 5"),
        (
            b"0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n20\n0\nENDSEC\n0\nEOF\n",
            "the drawing is in unit 20",
        ),
    ],
)
def test_files_that_are_no_drawings(drawn, text, message):
    with pytest.raises(ToolpathError, match=message):
        drawn.read(text)


def test_comments_blank_ends_and_carriage_returns(drawn):
    text = "999\nwritten by hand\n" + drawn.text([LINE]).replace("\n0\n", "\n  0\n") + "\x1a"
    assert drawn.length(drawn.read(text.replace("\n", "\r\n"))) == pytest.approx(5)


def test_a_binary_file_is_the_same_drawing(drawn, tmp_path):
    """Written by ezdxf: the plate, and its text in paper space."""
    text = read_drawing(drawn.DATA / "plate.dxf", drawn.FEED)
    path = tmp_path / "plate.dxf"
    document = ezdxf.readfile(drawn.DATA / "plate.dxf")
    document.units = 4
    document.saveas(path, fmt="bin")
    binary = read_drawing(path, drawn.FEED)
    np.testing.assert_allclose(binary.contour.polynomial, text.contour.polynomial, atol=1e-15)
    assert binary.ignored == text.ignored and not binary.line.any()


def test_a_file_that_states_no_version_keeps_its_layers(drawn):
    """ezdxf takes it for R12, whose entities have no marks."""
    text = drawn.text([f"{LINE} 8=cold", LINE], layers=["LAYER 2=cold 70=1"], unit=None)
    stated = "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n0\nENDSEC\n"
    assert text.startswith(stated)
    text = text.removeprefix(stated)
    actual = drawn.read(text, 1e-3)
    assert actual.ignored == ("1 LINE (layer cold, frozen)",)


@pytest.mark.parametrize("turns", [0, 3, 10**9])
def test_an_angle_of_many_turns_is_the_angle(drawn, turns):
    """DXF states no range: the arc from 90 to 180 degrees, begun some turns later."""
    once, actual = (
        drawn.dxf(f"ARC 10=0 20=0 40=5 50={90 + 360 * k} 51={180 + 360 * k}") for k in (0, turns)
    )
    np.testing.assert_allclose(actual.contour.position(0.0), [0.0, 5e-3], atol=1e-9)
    assert float(actual.contour.length) == pytest.approx(float(once.contour.length), rel=1e-9)


def test_a_clipped_block_is_drawn_whole_and_its_clipping_is_listed(drawn, tmp_path):
    document = ezdxf.new(units=4)
    document.blocks.new("B").add_line((0, 0), (3, 4))
    XClip(document.modelspace().add_blockref("B", (0, 0))).set_block_clipping_path([(0, 0), (1, 1)])
    document.saveas(tmp_path / "clipped.dxf")
    toolpath = read_drawing(tmp_path / "clipped.dxf", drawn.FEED)
    assert drawn.length(toolpath) == pytest.approx(5)
    assert toolpath.ignored == ("1 INSERT (layer 0, its clipping)",)


BYTES = [b"-", b"9", b".", b"\n", b"1e300", b"<g>", b"\xff", b"\0", b"\n0\nLINE\n"]
WORDS = ["0", "-1", "1e-9", "1e-300", "1e300", "1e5", "180", "nan", "-7.5", "65536"]
NUMBERS = re.compile(rb'(?<=[\n\s",(])-?[0-9]+\.?[0-9]*(?=[\s,",)])')


def mutated(content: bytes, draw: random.Random) -> bytes:
    for _ in range(draw.randint(1, 4)):
        if draw.random() < 0.7:
            actual = draw.choice(list(NUMBERS.finditer(content)))
            content = (
                content[: actual.start()] + draw.choice(WORDS).encode() + content[actual.end() :]
            )
        else:
            at = draw.randrange(len(content))
            kept = at + draw.choice([0, 0, 1, 20])
            content = content[:at] + draw.choice([*BYTES, b""]) + content[kept:]
    return content


@pytest.mark.parametrize("suffix", [".dxf", ".svg"])
def test_mutated_drawings(drawn, suffix):
    draw, taken = random.Random(1), 0
    original = (drawn.DATA / f"plate{suffix}").read_bytes()
    for _ in range(100):
        content = mutated(original, draw)
        try:
            drawn.read(content, 1e-3, suffix=suffix)
        except ToolpathError as error:
            assert len(str(error).splitlines()) == 1
        else:
            taken += 1
    assert 10 < taken < 90
