"""Toolpath files: our two parts, CSV points, and bytes that nobody would call a program."""

from functools import partial
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from jcontour.geometry.gcode.programs import interpreted
from jcontour.geometry.toolpath_rules import lines_of
from jcontour.geometry.toolpaths import ToolpathError, parse_gcode, read_csv, read_gcode

HEAD = "G21 G90 G17 F3000\n"
FEED = 0.05  # [m/s]

PARTS = Path(__file__).parents[3] / "jcontour" / "app" / "jobs" / "toolpaths"
BRACKET, CAM = PARTS / "bracket.ngc", PARTS / "cam.ngc"


def test_bracket(traced):
    toolpath = read_gcode(BRACKET)
    traced.assert_valid(toolpath)
    holes = 2 * 2 * np.pi * (0.8 + 0.6)
    slot = 3 + np.pi * 0.5 + 3 + np.pi * 0.5 + 3
    straight = 4 + 2 + 2 + 5.7 + 0.8 * np.sqrt(2) + 1.7 + 10 + 2
    outline = (
        straight + 4 * np.pi / 2 + 1.5 * np.pi / 2 + np.pi
    )  # fillets, inner fillet, lead-in and lead-out
    np.testing.assert_allclose(
        traced.lengths(toolpath)[~toolpath.rapid].sum(), holes + slot + outline, rtol=1e-12
    )
    assert toolpath.rapid.sum() == 3
    outline_points = traced.points(toolpath, np.linspace(0, 1, 33))[-14:].reshape(-1, 2)
    np.testing.assert_allclose(outline_points.max(axis=0), [12, 8], atol=1e-12)
    solid = read_gcode(BRACKET, axes="XYZ")
    np.testing.assert_allclose(traced.points(solid)[..., 2].min(), -1.0)


def test_cam_lies_on_its_law(traced):
    toolpath = read_gcode(CAM)
    traced.assert_valid(toolpath)
    assert bool(toolpath.contour.closed) and not toolpath.rapid.any() and toolpath.rapid.size > 250
    path = traced.points(toolpath, np.linspace(0, 1, 9)).reshape(-1, 2)
    angle = np.degrees(np.arctan2(path[:, 1], path[:, 0])) % 360

    def cycloid(x):
        return 3 * (x - np.sin(2 * np.pi * x) / (2 * np.pi))

    rise, dwell, back = angle < 90, angle < 150, angle < 270
    law = np.select(
        [rise, dwell, back], [5 + cycloid(angle / 90), 8.0, 8 - cycloid((angle - 150) / 120)], 5.0
    )
    np.testing.assert_allclose(np.linalg.norm(path, axis=1), law, atol=2e-4)
    pieces = jax.tree.map(np.asarray, toolpath.contour.pieces)
    before, after = pieces.jet(pieces.extent)[1][:-1], pieces.jet(0 * pieces.extent)[1][1:]
    assert (
        np.linalg.norm(after - before, axis=1).max() < 5e-4
    )  # [rad] five digits of a millimetre on arcs of 0.1 mm


def test_files_that_cannot_be_read(traced, tmp_path):
    with pytest.raises(ToolpathError, match="no such file"):
        read_gcode(tmp_path / "missing.ngc")
    with pytest.raises(ToolpathError, match="no such file"):
        read_gcode("null\0byte")
    with pytest.raises(ToolpathError, match="Is a directory"):
        read_gcode(tmp_path)
    (tmp_path / "latin.ngc").write_bytes(b"G1 X1 F100\n(caf\xe9)\n")  # not UTF-8, in a comment
    traced.assert_valid(read_gcode(tmp_path / "latin.ngc"))
    (tmp_path / "latin.ngc").write_bytes(b"G1 X1 F100\nX\xe9\n")
    with pytest.raises(ToolpathError, match=r"line 2: cannot read 'X\\xe9'"):
        read_gcode(tmp_path / "latin.ngc")
    (tmp_path / "latin.csv").write_bytes(b"0,0\n1,\xe9\n")
    with pytest.raises(ToolpathError, match="line 2: byte 0xe9 is not UTF-8"):
        read_csv(tmp_path / "latin.csv", FEED)
    for encoding in ("utf-8-sig", "utf-16"):
        (tmp_path / "mark.ngc").write_bytes("G1 X1 F100 (\u03bc)\r\n".encode(encoding))
        traced.assert_valid(read_gcode(tmp_path / "mark.ngc"))
    (tmp_path / "mark.ngc").write_bytes(b"\xef\xbb\xbfG1 X1 F100 (\xfcml\xe4ut)\n")  # and Latin-1
    traced.assert_valid(read_gcode(tmp_path / "mark.ngc"))
    for encoding in ("utf-16-le", "utf-16-be"):
        (tmp_path / "bare.ngc").write_bytes("G21 G90\r\nG1 X1 F100\r\n".encode(encoding))
        with pytest.raises(ToolpathError, match="line 1: cannot read"):
            read_gcode(tmp_path / "bare.ngc")


def test_control_characters_around_a_program_mean_nothing(tmp_path, traced):
    path = tmp_path / "tape.ngc"
    path.write_bytes(b"\0\0\r\n\x12%\r\nG1 X1 F100\r\n%\r\n\x14\0\x1a\x1a")
    toolpath = read_gcode(path)
    np.testing.assert_allclose(traced.lengths(toolpath), [1])
    assert toolpath.line.tolist() == [3]
    path.write_bytes(b"G1 X1 F100\nX\x1a2\nX3\x1a")
    with pytest.raises(ToolpathError, match=r"line 2: cannot read 'X\\x1a2'"):
        read_gcode(path)


def test_too_many_moves_and_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr("jcontour.geometry.gcode.moves.MOST_MOVES", 3)
    with pytest.raises(ToolpathError, match="line 4: more than 3 moves"):
        parse_gcode("F1 G1 X1\nX2\nX3\nX4\nX5")
    monkeypatch.setattr("jcontour.geometry.toolpath_rules.MOST_BYTES", 2**20)
    (tmp_path / "long.ngc").write_bytes(b"\n" * (2**20 + 1))
    with pytest.raises(ToolpathError, match="larger than 1 MiB"):
        read_gcode(tmp_path / "long.ngc")


def csv(tmp_path, text: str):
    (tmp_path / "points.csv").write_bytes(text.encode())
    return read_csv(tmp_path / "points.csv", FEED)


@pytest.mark.parametrize("head", ["", "x,y\n", "X_mm, Y_mm\r\n", "# from a scan\n\nx,y\n"])
def test_csv_in_millimetres(tmp_path, head):
    toolpath = csv(tmp_path, head + "0,0\n3,4\n3,4\n 3 , 5e0\n\n")
    np.testing.assert_allclose(toolpath.contour.extent, [5e-3, 1e-3], rtol=1e-14)
    assert toolpath.contour.axes == 2
    first = head.count("\n") + 1
    assert toolpath.line.tolist() == [first + 1, first + 3]
    assert toolpath.feed.tolist() == [FEED, FEED] and not toolpath.rapid.any()


def test_csv_in_space_and_closed(tmp_path):
    contour = csv(tmp_path, "x_mm,y_mm,z_mm\n0,0,0\n1,0,2\n0,1,0\n0,0,0").contour
    assert contour.axes == 3 and bool(contour.closed)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,0\n1,nan", "line 2: needs two or three numbers"),
        ("0,0\n1,1e400", "line 2: .* is farther than 100 m away"),
        ("0,0\n1,2,3,4", "line 2: needs two or three numbers"),
        ("0,0\n1,2,3", "line 2: needs 2 numbers as the lines above"),
        ("x,y\nx,z\n1,2", "line 2: needs two or three numbers"),
        ("0,0\nx,y", "line 2: needs two or three numbers"),
        ("0,0\n0,0\n1e-9,0", "fewer than two distinct points"),
        ("", "fewer than two distinct points"),
    ],
)
def test_csv_errors(tmp_path, text, message):
    with pytest.raises(ToolpathError, match=message):
        csv(tmp_path, text)


anything = settings(deadline=None, suppress_health_check=list(HealthCheck))


def assert_sound(traced, program: str, axes) -> None:
    try:
        toolpath = parse_gcode(program, axes)
    except ToolpathError as error:
        assert len(str(error).splitlines()) == 1
    else:
        traced.assert_valid(toolpath)
        # the check before anything heavy is loaded refuses nothing that is right
        interpreted(lines_of(program), axes=3, feed=None)


@settings(anything, max_examples=40)
@given(st.text(), st.sampled_from(["XY", "XYZ"]))
@example("G1X1F1\x0bX2\u2028", "XY")
def test_any_text(traced, text, axes):
    assert_sound(traced, text, axes)
    assert_sound(traced, HEAD + "G1 X1\n" + text, axes)


@settings(anything, max_examples=50)
@given(st.binary(max_size=200))
def test_any_bytes(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "any.ngc"
    path.write_bytes(content)
    for read in (read_gcode, partial(read_csv, feed=FEED)):
        try:
            read(path)
        except ToolpathError as error:
            assert len(str(error).splitlines()) == 1


signs = st.sampled_from([b"-", b"9", b"."])


@settings(anything, max_examples=50)
@given(st.data())
def test_mutated_parts(traced, tmp_path_factory, data):
    content = bytearray(data.draw(st.sampled_from([BRACKET, CAM])).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        where = data.draw(st.integers(0, len(content) - 1))
        kind = data.draw(st.sampled_from(["replace", "insert", "delete", "cut"]))
        if kind == "cut":
            del content[where : where + data.draw(st.integers(1, 200))]
        elif kind == "delete":
            del content[where]
        else:
            content[where : where + (kind == "replace")] = data.draw(
                st.one_of(st.binary(min_size=1, max_size=3), signs)
            )
        content = content or bytearray(b" ")
    path = tmp_path_factory.getbasetemp() / "mutated.ngc"
    path.write_bytes(content)
    try:
        toolpath = read_gcode(path, data.draw(st.sampled_from(["XY", "XYZ"])))
    except ToolpathError as error:
        assert len(str(error).splitlines()) == 1
    else:
        traced.assert_valid(toolpath)


def test_cuts_along_which_z_moves_too_are_numbered():
    ramp = "G21 F600 G0 X0 Y0 Z0\nG1 X10\nG1 X30 Z-1\nG1 X40\nG2 X50 Z-2 I5"
    assert parse_gcode(ramp, "XY").ramps == (1, 3)
    assert parse_gcode(ramp, "XYZ").ramps == ()
    assert parse_gcode("F600 G1 X10\nG2 X30 I10\nG1 Z-1\nG1 X40", "XY").ramps == ()


def test_lines_that_are_skipped_are_told():
    """As with block delete on; a line of / alone, or in a loop again, is none more."""
    loop = "o1 repeat [3]\n/G1 X9\nG91 G1 X1\no1 endrepeat\n"
    read = parse_gcode(f"G21 F100\n/\n/ (none)\n{loop}/M8\n")
    assert read.line.size == 3
    assert read.warnings[-1].startswith("2 lines that begin with / skipped")
    assert read.warnings[-1].endswith("the first at line 5")
    assert parse_gcode("G21 G1 X1 F9\n/\n").warnings == ()
