"""G-code against geometry worked out by hand, and its errors line by line."""

import re

import numpy as np
import pytest

from jcontour.geometry.toolpaths import ToolpathError, parse_gcode

HEAD = "G21 G90 G17 F3000\n"


def test_lines_and_rapids(traced):
    toolpath = parse_gcode(HEAD + "G0 X1 Y1\nG1 X4 Y5\nG0 X4 Y6\nG1 X5 F600\nG0 X0 Y0")
    np.testing.assert_allclose(traced.lengths(toolpath), [5, 1, 1], rtol=1e-14)
    np.testing.assert_array_equal(toolpath.rapid, [False, True, False])
    np.testing.assert_allclose(toolpath.feed, [0.05, np.nan, 0.01], rtol=1e-14)
    np.testing.assert_allclose(traced.points(toolpath)[0], [[1, 1], [2.5, 3], [4, 5]], rtol=1e-14)


def test_lines_of_the_pieces_and_words_without_meaning_for_the_path():
    program = "G90 G21 G94\n(a comment) N7 T2 M6\nS9000 M3\nG0 X1\nG1 X4 F600\n\nG3 X1 I-1.5 Y0\n"
    toolpath = parse_gcode(program + "G2 X0 Y1 R1 M8\nG64 P0.01 G1 X-1\nM5\nM30\nG1 X90")
    np.testing.assert_array_equal(toolpath.line, [5, 7, 8, 9])
    assert toolpath.ignored == ("M3", "M6", "S", "T")
    assert toolpath.tolerance == pytest.approx(10e-6)
    assert toolpath.stops == "2 stops: M8 at line 8, M5 at line 10"


def test_dwells_of_minutes_are_asked_about():
    program = HEAD + "G1 X4\nG4 P500\nX5\nG4 P60\nG4 P61"
    (warning,) = parse_gcode(program).warnings
    assert re.match(r"line \d: a dwell of 500 s and 1 more; P is in seconds here", warning)
    assert parse_gcode(HEAD + "G1 X4\nG4 P60").warnings == ()


def test_a_program_that_does_not_say_its_unit_is_asked_about():
    (warning,) = parse_gcode("G90\nG1 X4 F600").warnings
    assert "no G20 or G21" in warning
    for said in ("G20", "G21", "G70", "G71"):
        assert parse_gcode(f"{said} G90\nG1 X4 F600").warnings == ()


def test_the_number_of_a_spindle_is_told():
    toolpath = parse_gcode("F600 M3 $0 S1\nG1 X1\nM5 $-1\nG97 $1 S500\nG1 X2")
    assert toolpath.ignored == ("$", "G97", "M3", "S")
    assert toolpath.stops == "1 stop: M5 at line 3"


def test_a_first_move_without_a_motion_code_is_rapid(traced):
    toolpath = parse_gcode("G21 F600 G91\nZ5\nX2\nG1 Y1\nG0 X3\nG1 Y1")
    np.testing.assert_allclose(traced.points(toolpath, [0.0])[0], [[2, 0]], atol=1e-12)
    assert toolpath.rapid.tolist() == [False, True, False]
    (warning,) = toolpath.warnings
    assert warning.startswith("line 2: a move before any of G0 to G3 is read as G0")
    assert parse_gcode("G21 G53 Z0 F600\nG1 X1").warnings == (warning.replace("line 2", "line 1"),)


def test_an_arc_in_two_pieces_is_one_line():
    toolpath = parse_gcode(HEAD + "G0 X10\nG3 X10.004 Y0 I-10.001 J0\nG1 Y-3")
    assert len(toolpath.line) == 3
    np.testing.assert_array_equal(toolpath.line, [3, 3, 4])


def test_machine_starts_at_the_origin(traced):
    np.testing.assert_allclose(traced.points(parse_gcode(HEAD + "G1 X3 Y4"))[0, 0], [0, 0], atol=0)


def test_quarter_circles_in_both_directions(traced):
    counter_clockwise = parse_gcode(HEAD + "G0 X10 Y0\nG3 X0 Y10 I-10 J0")
    clockwise = parse_gcode(HEAD + "G0 X10 Y0\nG2 X0 Y10 I-10 J0")
    np.testing.assert_allclose(traced.lengths(counter_clockwise), [5 * np.pi], rtol=1e-14)
    np.testing.assert_allclose(traced.lengths(clockwise), [15 * np.pi], rtol=1e-14)
    np.testing.assert_allclose(
        traced.points(counter_clockwise)[0, 1], [10 * np.sqrt(0.5)] * 2, rtol=1e-14
    )
    np.testing.assert_allclose(traced.points(clockwise)[0, 1], [-10 * np.sqrt(0.5)] * 2, rtol=1e-14)
    np.testing.assert_allclose(counter_clockwise.contour.curvature(0.001), 100.0, rtol=1e-12)


def test_full_circle(traced):
    toolpath = parse_gcode(HEAD + "G0 X5 Y1\nG2 I-2 J0\nG3 X5 Y1 J3")
    np.testing.assert_allclose(traced.lengths(toolpath), [4 * np.pi, 6 * np.pi], rtol=1e-14)
    np.testing.assert_allclose(traced.points(toolpath)[:, 1], [[1, 1], [5, 7]], rtol=1e-14)
    assert bool(toolpath.contour.closed)


def test_full_circle_after_incremental_moves_that_do_not_sum_exactly(traced):
    toolpath = parse_gcode(
        "G91 F100 G1 X0.1\nX0.2\nG3 X0.1 Y0 I0.05\nX-0.1 I-0.05\nG90\nX0.3 Y0 I1"
    )
    np.testing.assert_allclose(traced.lengths(toolpath)[-1], 2 * np.pi, rtol=1e-14)


def test_helix(traced):
    toolpath = parse_gcode(HEAD + "G0 X10 Y0 Z1\nG3 X0 Y10 Z4 I-10", axes="XYZ")
    np.testing.assert_allclose(traced.lengths(toolpath), [np.hypot(5 * np.pi, 3)], rtol=1e-14)
    np.testing.assert_allclose(
        traced.points(toolpath)[0], [[10, 0, 1], [50**0.5, 50**0.5, 2.5], [0, 10, 4]], atol=1e-12
    )
    whole_turn = parse_gcode(HEAD + "G0 X10\nG2 Z-2 I-10", axes="XYZ")
    np.testing.assert_allclose(traced.lengths(whole_turn), [np.hypot(20 * np.pi, 2)], rtol=1e-14)
    np.testing.assert_allclose(traced.points(whole_turn)[0, 1], [-10, 0, -1], atol=1e-12)
    assert toolpath.contour.newton_steps > 0  # its nearest point is no closed form


@pytest.mark.parametrize(
    ("program", "middle"),
    [
        ("G17 G0 X10 Y0\nG3 X0 Y10 I-10", (50**0.5, 50**0.5, 0)),  # x to y
        ("G18 G0 Z10\nG3 X10 Z0 K-10", (50**0.5, 0, 50**0.5)),  # z to x
        ("G18 G0 Z10\nG2 X-10 Z0 K-10", (-(50**0.5), 0, 50**0.5)),
        ("G19 G0 Y10\nG3 Y0 Z10 J-10", (0, 50**0.5, 50**0.5)),  # y to z
        ("G19 G0 Y10\nG3 Y0 Z10 R10", (0, 50**0.5, 50**0.5)),
        ("G18 G0 Z10\nG3 X10 Z0 R10", (50**0.5, 0, 50**0.5)),
        ("G19 G0 Y10\nG3 X4 Y0 Z10 J-10", (2, 50**0.5, 50**0.5)),  # helix along x
    ],
)
def test_planes(traced, program, middle):
    np.testing.assert_allclose(
        traced.points(parse_gcode(HEAD + program, axes="XYZ"))[0, 1], middle, atol=1e-9
    )


def test_inches_are_25_4_mm(traced):
    inches = parse_gcode("G20 G90 G0 X1 G17\nG1 Y2 F60\nG3 X0 Y3 I-1 J0\nG2 X1 Y4 R1")
    metric = parse_gcode(
        "G21 G90 G0 X25.4 G17\nG1 Y50.8 F1524\nG3 X0 Y76.2 I-25.4 J0\nG2 X25.4 Y101.6 R25.4"
    )
    np.testing.assert_allclose(traced.points(inches), traced.points(metric), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(inches.feed, metric.feed, rtol=1e-14)
    np.testing.assert_allclose(inches.feed, 0.0254, rtol=1e-14)


def test_incremental_end_points(traced):
    absolute = parse_gcode(HEAD + "G0 X2 Y3\nG1 X5\nG3 X7 Y5 I0 J2\nG1 X7 Y9")
    incremental = parse_gcode(HEAD + "G91 G0 X2 Y3\nG1 X3\nG3 X2 Y2 I0 J2\nG1 Y4")
    np.testing.assert_allclose(traced.points(incremental), traced.points(absolute), atol=1e-12)


def test_modes_stay(traced):
    modal = parse_gcode("g21g90f3000\ng1x1\nx2y1\ng3x1y2i-1\nx0y1j-1\ng1\n\nx0y0\nG91\nY-2")
    spelled_out = parse_gcode(
        HEAD + "G01 X1.0 Y0\nG1.0 X+2. Y 1\nG03 X1 Y2 I-1 J0\nG3 X0 Y1 I0 J-1\nG1 X0 Y0\nG1 X0 Y-2"
    )
    np.testing.assert_allclose(traced.points(modal), traced.points(spelled_out), atol=1e-12)


def test_layout(traced):
    plain = parse_gcode(HEAD + "G1 X1\nG1 Y2")
    dressed = parse_gcode(
        "%\r\n(PART (1: G2 X9)\r\nN10 G21 G90 (mm) G17 F3000 ; all G1 X99\r\n"
        "/G1 X50\r\nT1 M6 S24000 M3\r\nG64 P0.01\r\n"
        "N20 G1(a)X1\rN30 G1Y2 M8\nG80 M5\nM30\nG1 X100 nonsense %%%"
    )
    np.testing.assert_array_equal(traced.points(plain), traced.points(dressed))


def test_projection_drops_z_and_keeps_durations(traced):
    program = HEAD + "G0 Z5\nX1\nG1 Z0 F60\nX4 Z-4 F3000\nG3 X4 Y2 Z-5 J1\nG1 Z5\nX5"
    flat, solid = parse_gcode(program), parse_gcode(program, axes="XYZ")
    np.testing.assert_allclose(traced.lengths(flat), [3, np.pi, 1], rtol=1e-14)
    np.testing.assert_allclose(
        traced.lengths(solid), [5, 5, np.hypot(np.pi, 1), 10, 1], rtol=1e-14
    )  # the plunge is the first cutting move
    np.testing.assert_allclose(
        traced.lengths(flat) / flat.feed,
        (traced.lengths(solid) / solid.feed)[[1, 2, 4]],
        rtol=1e-14,
    )
    assert flat.contour.axes == 2 and solid.contour.axes == 3


def test_given_feed_replaces_the_programmed_one():
    toolpath = parse_gcode("G1 X1\nG0 X2\nG1 X3 F100", feed=0.02)
    np.testing.assert_array_equal(toolpath.feed, [0.02, np.nan, 0.02])


@pytest.mark.parametrize("word", ["F0", "F999999999", "F#<_hal[plasmac.cut-feed-rate]>"])
def test_a_given_feed_replaces_what_no_machine_can_run(word):
    """Programs without a feed, at full speed, or for a plasma table, which keeps its own."""
    program = f"G20 {word} G1 X1\nG0 X2\nG1 X3"
    assert np.nanmax(np.abs(parse_gcode(program, feed=0.02).feed - 0.02)) < 1e-15
    with pytest.raises(ToolpathError, match="line 1: .*--feed-mm-per-min gives"):
        parse_gcode(program)


def test_moves_without_length_are_dropped(traced):
    np.testing.assert_allclose(
        traced.lengths(parse_gcode(HEAD + "G1 X1\nX1 Y0\nG0 X1\nG1 X2")), [1, 1]
    )


@pytest.mark.parametrize("sweep", [0.001, 0.1, 1.0, 3.0, 3.3, 5.0, 6.2])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("off", [-2e-4, 1e-4, 4e-3])  # [mm]
def test_arc_slightly_off_its_circle_meets_both_ends(traced, sweep, direction, off):
    radius, end = 10.0, (10.0 + off) * np.array([np.cos(sweep), direction * np.sin(sweep)])
    toolpath = parse_gcode(
        HEAD + f"G0 X10\nG{3 if direction > 0 else 2} X{end[0]:.9f} Y{end[1]:.9f} I-10"
    )
    traced.assert_valid(toolpath)
    fractions = np.linspace(0, 1, 101)
    path = traced.points(toolpath, fractions).reshape(-1, 2)
    np.testing.assert_allclose(path[[0, -1]], [[10, 0], end], atol=1e-8)
    assert np.abs(np.linalg.norm(path, axis=1) - radius).max() < 1.5 * abs(off) + 1e-8
    np.testing.assert_allclose(
        traced.lengths(toolpath).sum(), (radius + off / 2) * sweep, atol=abs(off)
    )


def test_radii_may_differ_as_in_linuxcnc(traced):
    """By 0.02 sqrt(2) mm or 0.002 sqrt(2) inch, or a thousandth up to a hundred times that."""
    traced.assert_valid(parse_gcode("F100 G2 X2.0282 I1"))  # 28.2 um
    traced.assert_valid(parse_gcode("F100 G20 G2 X0.2028 I0.1"))  # 2.8 thousandths of an inch
    traced.assert_valid(parse_gcode("F100 G2 X200.1 I100"))  # 0.1 %
    traced.assert_valid(parse_gcode("F100 G2 X6002.82 I3000"))  # 2.82 mm
    for program in (
        "F100 G2 X2.0284 I1",
        "F100 G20 G2 X0.2029 I0.1",
        "F100 G2 X200.102 I100",
        "F100 G2 X6002.84 I3000",
    ):
        with pytest.raises(ToolpathError, match="off its circle"):
            parse_gcode(program)


def test_arc_a_little_too_short_by_radius_is_a_half_circle(traced):
    toolpath = parse_gcode(HEAD + "G3 X10.002 R5.0")
    np.testing.assert_allclose(traced.lengths(toolpath), [5.001 * np.pi], rtol=1e-12)


def test_many_moves(any_type):
    angle = np.linspace(0, 2 * np.pi, 5001)[1:]
    program = (
        HEAD
        + "G0 X10\n"
        + "\n".join(f"G1 X{10 * np.cos(a):.6f} Y{10 * np.sin(a):.6f}" for a in angle)
    )
    toolpath = parse_gcode(program)
    assert toolpath.rapid.size == 5000 and bool(toolpath.contour.closed)


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("G1 X1 F100\nG1 Q3", r"line 2: unknown word 'Q3'"),
        ("G1 X1 F100 A2", r"line 1: 'A2' moves an axis that is not simulated"),
        ("G1 X1 F100 $2", r"line 1: unknown word '\$2'"),
        ("G1 X1.2.3 F100", r"line 1: cannot read '.3 F100'"),
        ("G1 X F100", r"line 1: cannot read 'X F100'"),
        ("? G1 X1 F100", r"line 1: cannot read '\? G1"),
        ("$H", r"line 1: cannot read '\$H'"),
        ("$32 = 1", r"line 1: cannot read '= 1'"),
        ("G1 X1e3 F100", r"line 1: cannot read 'e3 F100': controls know no exponents"),
        ("G1 X1 F100 (open", r"line 1: a comment without its \): 'G1 X1 F100 \(open'"),
        ("G1 X1 (a (b) c))", r"line 1: a \) too many: 'G1 X1 \(a \(b\) c\)\)'"),
        ("G1 X\u0663 F100", r"line 1: cannot read 'X\\u0663 F100'"),
        ("G1 X" + "9" * 400 + " F100", r"line 1: the number in 'Xinf' is too large"),
        ("G1 X200000 F100", r"line 1: a coordinate is farther than 100 m"),
        ("G91 F100\n" + "G1 X60000\n" * 2, r"line 3: a coordinate is farther than 100 m"),
        ("\n\nG41 D1", r"line 3: cutter compensation needs the tool's diameter: --tool-table"),
        ("G12.5", r"line 1: 'G12.5' is not supported"),
        ("G1.23", r"line 1: ten times a G code needs to be whole"),
        ("M98 P3", r"line 1: there is no subprogram o3"),
        ("M98", r"line 1: M98 needs P"),
        ("M3.5", r"line 1: an M code needs to be whole"),
        ("M10000", r"line 1: 'M10000' is not supported"),
        ("N-1 G1 X1 F1", r"line 1: 'N-1': N needs a number that is not negative"),
        ("G0 G1 X1 F100", r"line 1: 'G1' and another G code of its kind"),
        ("G1 X1 X2 F100", r"line 1: X is given twice"),
        ("G80 X1 F100", r"line 1: axis words without a motion mode"),
        ("X1 F100", r"the program has no cutting move"),
        ("G1 X1", r"line 1: a cutting move without a feed"),
        ("F0 G1 X1", r"line 1: a cutting move at a feed of 0"),
        ("F-5 G1 X1", r"line 1: the feed needs to be 0.06 to 6000000 mm/min, received F-5;"),
        (
            "F99999999 G1 X1",
            r"line 1: the feed needs to be [^/]* mm/min, received F99999999; --feed",
        ),
        ("G20 F.001 G1 X1", r"line 1: the feed needs to be [^/]*/min, received F0.001 in inches;"),
        ("o<m41\x10> sub\nM2", r"line 1: o<m41\\x10> sub has no end"),
        ("F600 G18 G2 K10", r"line 1: a cut in the plane of G18 needs a third axis"),
        ("G1 X1 I2 F100", r"line 1: I, J, K and R belong to arcs"),
        (
            "F100 G2 X2 I0.9",
            r"line 1: the end of the arc is off its circle: the radius is 0.9 mm .* "
            r"and 1.1 mm at the end, 0.2 mm apart",
        ),
        ("F100 G2 I0 J0", r"line 1: an arc without a radius"),
        (
            "F100 G2 X2 R0.9",
            r"line 1: a radius of 0.9 mm does not reach the end of the arc, 2 mm away",
        ),
        ("F100 G2 R5", r"line 1: an arc by radius \(R\) needs an end apart from its start"),
        ("", r"the program has no cutting move"),
        ("F100 G1 Z-5\nG1 X0", r"the program has no cutting move \(G1, G2, G3\) along X or Y"),
        ("M30\nG1 X1 F100", r"the program has no cutting move"),
    ],
)
def test_errors_name_the_line(program, message):
    with pytest.raises(ToolpathError) as caught:
        parse_gcode(program)
    assert re.match(message, str(caught.value)), str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("feed", [0.0, -1.0, np.nan, np.inf])
def test_given_feed_is_checked(feed):
    with pytest.raises(ToolpathError, match="feed: needs to be above 0"):
        parse_gcode("G1 X1", feed=feed)


def test_axes_are_checked(any_type):
    with pytest.raises(ToolpathError, match="axes"):
        parse_gcode("G1 X1 F1", axes="XZ")  # pyright: ignore[reportArgumentType]
