"""SVG: closed forms of shapes and paths, transforms, viewports, units, and files that are none."""

import numpy as np
import pytest
from scipy.special import ellipe

from jcontour.geometry.reading import read_drawing
from jcontour.geometry.toolpath_rules import ToolpathError
from jcontour.geometry.toolpaths import read_gcode

NM = 1e-6  # [mm]
SIZE = 'width="100mm" height="50mm" viewBox="0 0 100 50"'
XMLNS = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'


@pytest.fixture
def svg(drawn):
    def read(body, size=SIZE, given=None, head=""):
        text = f"{head}<svg {XMLNS} {size}>\n{body}\n</svg>\n"
        return drawn.read(text, given, suffix=".svg")

    return read


def test_the_same_plate_as_program_dxf_and_svg(drawn, traced):
    program = read_gcode(drawn.DATA / "plate.ngc")
    places = np.linspace(0, 1, 9)
    for suffix in ("svg", "dxf"):
        drawing = read_drawing(drawn.DATA / f"plate.{suffix}", drawn.FEED)
        np.testing.assert_allclose(
            traced.points(drawing, places), traced.points(program, places), atol=1e-9
        )
        assert drawing.rapid.tolist() == program.rapid.tolist()
        np.testing.assert_allclose(drawing.feed, program.feed)
    assert set(drawing.line) > {20}


def test_an_ellipse_and_a_curve_are_the_same_in_dxf_and_svg(drawn, svg, traced):
    """A Bezier curve is the spline of the same control points and the knots 0 0 0 0 1 1 1 1."""
    half = f"ELLIPSE 10=20 20=20 11=8 21=0 40=0.5 41=0 42={np.pi}"
    knots = " ".join(["40=0"] * 4 + ["40=1"] * 4)
    spline = f"SPLINE 71=3 {knots} 10=50 20=10 10=60 20=40 10=70 20=0 10=90 20=30"
    from_dxf = drawn.dxf(half, spline)
    from_svg = svg('<path d="M28 30A8 4 0 0 0 12 30M50 40C60 10 70 50 90 20"/>')
    assert from_dxf.contour.extent.shape == from_svg.contour.extent.shape
    np.testing.assert_allclose(
        traced.points(from_svg, np.linspace(0, 1, 9)),
        traced.points(from_dxf, np.linspace(0, 1, 9)),
        atol=1e-8,
    )


def test_shapes(drawn, svg):
    for body, length in (
        ('<rect x="5" y="5" width="30" height="20"/>', 100),
        ('<rect x="5" y="5" width="30" height="20" rx="5"/>', 60 + 10 * np.pi),
        ('<circle cx="20" cy="20" r="10"/>', 20 * np.pi),
        ('<ellipse cx="20" cy="20" rx="12" ry="6"/>', 48 * ellipe(0.75)),
        ('<line x1="1" y1="1" x2="4" y2="5"/>', 5),
        ('<polyline points="0,0 3,4,3 10"/>', 11),
        ('<polygon points="0,0 3,0 3 4"/>', 12),
        ('<rect width="1cm" height="50%"/>', 2 * (10 * 96 / 25.4 + 25)),
    ):
        assert drawn.length(svg(body)) == pytest.approx(length, abs=100 * NM)


def test_a_rounded_rectangle_is_one_outline_that_stays_within_its_corners(drawn, svg):
    """Quarters of an ellipse of 6 x 4 around (11, 9) and the three others, sides between them."""
    toolpath = svg('<rect x="5" y="5" width="30" height="20" rx="6" ry="4"/>')
    assert not toolpath.rapid.any() and bool(toolpath.contour.closed)
    x, y = np.abs(drawn.cut(toolpath) - [20, 35]).T  # from its middle; y points up from 50
    corner = (x > 9 + 1e-9) & (y > 6 + 1e-9)
    ellipse = ((x - 9) / 6) ** 2 + ((y - 6) / 4) ** 2
    np.testing.assert_allclose(ellipse[corner], 1, atol=1e-6)
    np.testing.assert_allclose(np.maximum(x / 15, y / 10)[~corner], 1, atol=1e-9)
    straight = 2 * (30 - 2 * 6) + 2 * (20 - 2 * 4)
    assert drawn.length(toolpath) == pytest.approx(straight + 24 * ellipe(1 - (4 / 6) ** 2))


def test_y_points_up_from_the_lower_left_corner(drawn, svg):
    points = drawn.cut(svg('<line x1="10" y1="50" x2="30" y2="45"/>'), 2)
    np.testing.assert_allclose(points, [[10, 0], [30, 5]], atol=1e-12)


def test_path_letters(drawn, svg):
    """Absolute and relative letters, without spaces, smooth curves, and several subpaths."""
    same = (
        "M10 10L20 10H30V20C30 30 40 30 40 20S50 10 50 20Q55 30 60 20T70 20A5 5 0 0 1 80 20Z",
        "m10,10 10 0h10v10c0 10 10 10 10 0s10-10 10 0q5 10 10 0t10 0a5 5 0 0110 0z",
    )
    first, second = (drawn.cut(svg(f'<path d="{data}"/>')) for data in same)
    np.testing.assert_allclose(first, second, atol=1e-9)
    moved = svg('<path d="M1 1 4 5M10 10h5zm0 10h5"/>')
    assert drawn.length(moved) == pytest.approx(5 + 5 + 5, abs=5.1)
    assert np.count_nonzero(moved.rapid) == 2


def test_arcs_by_their_ends(drawn, svg):
    """Of the four arcs through two points, large and sweep choose one; short radii grow."""
    for large, sweep in ((0, 0), (0, 1), (1, 0), (1, 1)):
        arc = svg(f'<path d="M20 20A10 10 0 {large} {sweep} 30 30"/>')
        assert drawn.length(arc) == pytest.approx(10 * np.pi * (1.5 if large else 0.5))
        middle = drawn.cut(arc, 3)[1] - [25, 25]
        # towards larger angles with y downwards, a small arc passes to the upper right
        right = middle[0] + middle[1] > 0
        assert right == bool(sweep)
    grown = svg('<path d="M20 20A1 2 0 0 1 40 20"/>')
    assert drawn.length(grown) == pytest.approx(4 * 20 * ellipe(0.75) / 2, abs=100 * NM)
    turned = drawn.cut(svg('<path d="M28 20A8 4 30 0 1 12 20z"/>'))
    assert np.isfinite(turned).all()


def test_transforms_act_from_right_to_left(drawn, svg):
    body = (
        '<g transform="translate(40,20) rotate(90)"><g transform="scale(2,0.5)">'
        '<line x1="0" y1="0" x2="5" y2="8"/></g></g>'
    )
    np.testing.assert_allclose(drawn.cut(svg(body), 2), [[40, 30], [36, 20]], atol=1e-9)
    skewed = svg('<circle r="10" transform="matrix(1 0 0.5 1 40 25) rotate(20, 0 0)"/>')
    x, y = (drawn.cut(skewed) - [40, 25]).T
    np.testing.assert_allclose(np.hypot(x + 0.5 * y, y), 10, atol=20 * NM)


def test_what_has_no_size_is_not_cut(svg):
    """A circle of no radius, seen through a transform; it is no last rapid move either."""
    body = '<path d="M0 0H9"/><g transform="scale(0,0)"><circle cx="7" r="4"/></g>'
    toolpath = svg(body)
    assert toolpath.rapid.size == 1


def test_viewports_symbols_and_use(drawn, svg):
    """A viewBox of 10 x 10 in 40 x 20 is doubled and in the middle, or stretched."""
    inner = '<svg x="10" y="5" width="40" height="20" viewBox="0 0 10 10" {}>{}</svg>'
    line = '<line x1="0" y1="0" x2="10" y2="10"/>'
    middle = drawn.cut(svg(inner.format("", line)), 2)
    np.testing.assert_allclose(middle, [[20, 45], [40, 25]], atol=1e-9)
    wide = drawn.cut(svg(inner.format('preserveAspectRatio="none"', line)), 2)
    np.testing.assert_allclose(wide, [[10, 45], [50, 25]], atol=1e-9)
    used = svg(
        f'<defs><g id="a">{line}</g></defs><use xlink:href="#a" x="5" transform="scale(2)"/>'
        f'<symbol id="b" viewBox="0 0 10 10">{line}</symbol>'
        '<use href="#b" x="60" width="20" height="20"/>'
    )
    points = drawn.cut(used, 2)
    np.testing.assert_allclose(points, [[10, 50], [30, 30], [60, 50], [80, 30]], atol=1e-9)


def test_units(drawn, svg):
    line = '<line x1="0" y1="0" x2="30" y2="40"/>'
    for size, mm in (
        ('width="100mm" height="100mm" viewBox="0 0 100 100"', 50),
        ('width="10cm" height="10cm" viewBox="0 0 200 200"', 25),
        ('width="2in" height="2in" viewBox="0 0 100 100"', 25.4),
        ('width="144pt" height="144pt" viewBox="0 0 100 100"', 25.4),
    ):
        assert drawn.length(svg(line, size)) == pytest.approx(mm)
    for size in ("", 'width="100" height="100"', 'width="100px" viewBox="0 0 9 9"', 'width="9mm"'):
        with pytest.raises(ToolpathError, match="does not say its unit .* px for 1/96 inch"):
            svg(line, size)
        assert drawn.length(svg(line, size, given=1e-3)) == pytest.approx(50)


def test_what_is_not_drawn_is_told(svg):
    actual = svg(
        '<text>a</text><image/><g style="display:none"><line x2="5"/></g><line x2="3"/>'
        '<g clip-path="url(#c)"><rect width="1" height="1"/></g><defs><line x2="9"/></defs>'
        '<flowRoot><flowRegion><rect width="7" height="7"/></flowRegion></flowRoot>'
    )
    assert actual.ignored == ("1 clip-path", "1 flowRoot", "1 hidden g", "1 image", "1 text")


def test_a_visible_child_of_a_hidden_group_is_cut(drawn, svg):
    """Visibility is inherited until it is given anew; display hides all that is within."""
    small, large = '<circle {} cx="5" cy="9" r="3"/>', '<circle {} cx="50" cy="20" r="10"/>'
    seen, veiled = 'visibility="visible"', 'style="visibility:hidden"'
    for body, radius, left_out in (
        (f"<g {veiled}>{small}{large}</g>".format("", seen), 10, "1 hidden circle"),
        (f"<g {veiled}><g>{small}</g></g>{large}".format("", ""), 10, "1 hidden circle"),
        (f"<g {veiled}><g {seen}>{small}{large}</g></g>".format("", veiled), 3, "1 hidden circle"),
        (f'<g visibility="collapse">{small}</g>{large}'.format("", ""), 10, "1 hidden circle"),
        (f'<g display="none">{small}</g>{large}'.format(seen, ""), 10, "1 hidden g"),
        (
            f'<defs>{small}{large}</defs><use href="#a" {veiled}/><use href="#b" {veiled}/>'.format(
                'id="a"', f'id="b" {seen}'
            ),
            10,
            "1 hidden circle",
        ),
    ):
        actual = svg(body)
        assert drawn.length(actual) == pytest.approx(2 * np.pi * radius, abs=100 * NM)
        assert actual.ignored == (left_out,)
    root = svg(f"{small}{large}".format("", seen), size=f'{SIZE} visibility="hidden"')
    assert drawn.length(root) == pytest.approx(20 * np.pi, abs=100 * NM)


def line_of(length, given=""):
    return f'<line x2="{length}" {given}/>'


@pytest.mark.parametrize(
    ("children", "length", "left_out"),
    [
        (line_of(3, 'systemLanguage="xx"') + line_of(5) + line_of(7), 5, 2),
        (line_of(3, 'systemLanguage="de, en-GB"') + line_of(5), 3, 1),
        (line_of(3, 'systemLanguage="EN"') + line_of(5), 3, 1),
        (line_of(3, 'systemLanguage="eng"') + line_of(5), 5, 1),
        (line_of(3, 'systemLanguage=""') + line_of(5), 5, 1),
        (line_of(3, 'requiredExtensions="http://x.org"') + line_of(5), 5, 1),
        (line_of(3, 'requiredFeatures="http://x.org" requiredExtensions=""') + line_of(5), 3, 1),
        ("<desc>a</desc>" + line_of(3) + line_of(5), 3, 1),
    ],
)
def test_the_first_child_of_a_switch_whose_conditions_hold_is_cut(
    drawn, svg, children, length, left_out
):
    actual = svg(f"<switch>{children}</switch>")
    assert drawn.length(actual) == pytest.approx(length)
    assert actual.ignored == (f"{left_out} line not chosen by a switch",)


def test_a_hidden_choice_stays_the_choice_and_conditions_hold_without_a_switch(drawn, svg):
    veiled = line_of(3, 'display="none"')
    hidden = svg(f"<switch>{veiled}{line_of(5)}</switch>{line_of(9)}")
    assert drawn.length(hidden) == pytest.approx(9)
    assert hidden.ignored == ("1 hidden line", "1 line not chosen by a switch")
    french = svg(line_of(3, 'systemLanguage="fr"') + line_of(5))
    assert drawn.length(french) == pytest.approx(5)
    assert french.ignored == ("1 line for another language or program",)


def test_a_program_s_own_copy_in_a_switch_is_left_for_the_drawing(drawn, svg):
    """As Illustrator writes it."""
    own = '<foreignObject requiredExtensions="http://ns.adobe.com/AdobeIllustrator/10.0/"/>'
    actual = svg(f"<switch>{own}<g>{line_of(4)}</g></switch>")
    assert drawn.length(actual) == pytest.approx(4)
    assert actual.ignored == ("1 foreignObject not chosen by a switch",)


EXTERNAL = '<!DOCTYPE svg [<!ENTITY secret SYSTEM "file:///etc/hostname">]>\n'
LAUGHS = "<!DOCTYPE svg [<!ENTITY a0 'ha'>{}]>\n".format(
    "".join(f"<!ENTITY a{k + 1} '{f'&a{k};' * 10}'>" for k in range(12))
)


@pytest.mark.parametrize(
    ("body", "head", "message"),
    [
        ("&secret;", EXTERNAL, "line 1: the entity 'secret' is outside the file and is not read"),
        ("<text>&a12;</text>", LAUGHS, "broken XML"),
        ("<g>" * 300 + "</g>" * 300, "", "line 2: elements more than 200 deep"),
        ("<g>", "", "line 3: broken XML: mismatched tag"),
        ("", "", "no lines or curves are drawn"),
        ("<text/>", "", "no lines or curves are drawn; left out: 1 text"),
        ('<path d="M0 0 L1 x"/>', "", "line 2: path data cannot be read from 'x'"),
        ('<path d="L1 1"/>', "", "line 2: path data cannot be read from 'L1 1'"),
        ('<path d="M0 0 A1 1 0 2 1 3 3"/>', "", "line 2: path data cannot be read"),
        ('<path d="M0 0 A1 1 1e3000 0 1 3 3"/>', "", "line 2: path data cannot be read"),
        ('<circle r="1em"/>', "", "line 2: r needs a length in px, mm"),
        ('<line x2="1e9"/>', "", "line 2: a point is farther than 100 m away"),
        ('<path d="M0 0A1e200 1 0 0 1 1 1"/>', "", "line 2: (a point is farther|a number is too)"),
        ('<g transform="turn(3)"/>', "", r"line 2: transform cannot be read from 'turn\(3\)'"),
        ('<use href="#none"/>', "", "no lines or curves are drawn; left out: 1 use of a missing"),
        ('<g id="a"><use href="#a"/></g>', "", "line 2: '#a' uses itself, or 32 deep"),
        ('<polygon points="0 0 a"/>', "", "line 2: points needs numbers, received 'a'"),
    ],
)
def test_bad_drawings(svg, body, head, message):
    with pytest.raises(ToolpathError, match=message) as raised:
        svg(body, head=head)
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "broken XML: no element found"),
        (b"<html/>", "its root is no svg element"),
        (b"\x89PNG\r\n\x1a\n\0\0", "line 1: broken XML: not well-formed"),
        (b"G1 X1 F100\n", "line 1: broken XML: syntax error"),
        (b'<svg viewBox="0 0 0 9"/>', "line 1: viewBox needs four numbers"),
    ],
)
def test_files_that_are_no_svg(drawn, text, message):
    with pytest.raises(ToolpathError, match=message):
        drawn.read(text, 1e-3, suffix=".svg")


@pytest.mark.parametrize("encoding", ["UTF8.0", "utf-16", "windows-1251"])
@pytest.mark.parametrize("written", ["utf-8", "latin-1"])
def test_text_is_read_whatever_encoding_it_states(drawn, encoding, written):
    head = f'<?xml version="1.0" encoding="{encoding}"?>'
    body = '<svg xmlns="http://www.w3.org/2000/svg"><line x2="3"/><text>\xe9</text></svg>'
    read = drawn.read((head + body).encode(written), 1e-3, suffix=".svg")
    assert float(read.contour.length) == pytest.approx(3e-3)


@pytest.mark.parametrize(("version", "pixels"), [("0.48.4 r9939", 90), ("0.91", 90), ("1.2.2", 96)])
@pytest.mark.parametrize("size", ['width="900" height="450px"', 'width="254mm" height="127mm"'])
@pytest.mark.parametrize("given", [None, 25.4e-3 / 96])
def test_pixels_of_inkscape_are_those_of_its_version(svg, drawn, version, pixels, size, given):
    """Without a viewBox, user units are px; one that is said in px is the program's own."""
    names = 'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" version="1.1"'
    size = f'{names} inkscape:version="{version}" {size}'
    read = svg(f'<line x2="{pixels}"/>', size=size, given=given)
    assert drawn.length(read) == pytest.approx(25.4)
    height = 127.0 if "mm" in size else 450 / pixels * 25.4
    assert drawn.cut(read)[0, 1] == pytest.approx(height)
    assert read.warnings[0].startswith(f"Inkscape {version.split()[0]}: {pixels} px")


def test_a_unit_that_is_said_comes_before_the_version_of_inkscape(svg, drawn):
    names = 'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
    old = f'{names} inkscape:version="0.48"'
    assert drawn.length(svg('<line x2="50"/>', size=f"{SIZE} {old}")) == pytest.approx(50)
    given = svg('<line x2="50"/>', size=f'width="900" {old}', given=1e-3)
    assert drawn.length(given) == pytest.approx(50)
    assert given.warnings == ()


def test_a_bomb_of_uses_is_refused(svg, monkeypatch):
    monkeypatch.setattr("jcontour.geometry.drawings.svg.MOST_MOVES", 5000)
    levels = [
        f'<g id="g{k}">{f"<use href=&quot;#g{k + 1}&quot;/>" * 10}</g>'.replace("&quot;", '"')
        for k in range(9)
    ]
    with pytest.raises(ToolpathError, match="more than 5000 elements"):
        svg("".join(levels) + '<g id="g9"/>')
