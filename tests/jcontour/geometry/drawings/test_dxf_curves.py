"""Polylines and splines of DXF, before they are joined, against points worked out by hand."""

import cmath
import math

import numpy as np
import pytest

from jcontour.geometry.drawings.dxf_curves import light_polyline, spline
from jcontour.geometry.drawings.dxf_placing import scaled
from jcontour.geometry.drawings.dxf_tags import Entity, Tag
from jcontour.geometry.toolpath_rules import ToolpathError


def entity(kind, *pairs):
    return Entity(kind, 7, [Tag(code, str(value), 8) for code, value in pairs])


def test_a_raised_polyline_that_leans_is_seen_where_its_points_are():
    """Its own x is the drawing's y, and its own y leans away by 60 degrees from -x."""
    lean = math.radians(60)
    raised, up = 5.0, [(210, math.sin(lean)), (220, 0.0), (230, math.cos(lean))]
    points = [(0.0, 0.0), (4.0, 0.0), (4.0, 2.0)]
    tags = [pair for x, y in points for pair in ((10, x), (20, y))]
    tags.insert(4, (42, 1.0))  # half a circle from the second point to the third
    found = light_polyline(entity("LWPOLYLINE", (38, raised), *up, *tags), scaled(1.0))
    seen = [complex(raised * math.sin(lean) - y * math.cos(lean), x) for x, y in points]
    line, arc = found
    ends = [line.start, line.end, arc.start, arc.end]
    np.testing.assert_allclose(ends, [seen[0], seen[1], seen[1], seen[2]], atol=1e-14)
    farthest = complex(raised * math.sin(lean) - math.cos(lean), 5.0)  # of the half circle
    assert arc.middle() == pytest.approx(farthest)


def test_a_closed_spline_through_points_has_no_corner_where_it_closes():
    points = [(0, 0), (3, -1), (4, 2), (1, 3), (0, 0)]
    tags = [pair for x, y in points for pair in ((11, x), (21, y))]
    found = spline(entity("SPLINE", (70, 1), (71, 3), *tags), scaled(1.0))
    assert [one.start for one in found] == pytest.approx([complex(*point) for point in points[:-1]])
    back = -found[-1].backwards().heading()
    assert cmath.phase(found[0].heading() / back) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("degree", [0, -1, 1000])
def test_a_spline_of_no_degree_is_refused(degree):
    knots = [(40, k) for k in range(3 + degree)] if degree < 9 else []
    tags = [(10, 0), (20, 0), (10, 1), (20, 1), *knots]
    with pytest.raises(ToolpathError, match=f"line 7: SPLINE of degree {degree}$"):
        spline(entity("SPLINE", (71, degree), *tags), scaled(1.0))
