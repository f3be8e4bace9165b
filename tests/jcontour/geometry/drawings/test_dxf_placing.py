"""Own systems of DXF entities, by what defines them: right angles, and which axis helped."""

import numpy as np
import pytest

from jcontour.geometry.drawings.dxf_placing import own_system
from jcontour.geometry.drawings.dxf_tags import Entity, Tag

STEEP = 1 / 64  # Autodesk's own number
STEEP_SIDES = [(STEEP, 0), (0, STEEP), (-STEEP, 0), (0, -STEEP), (0.6, -0.64), (-0.6, 0.64)]
SIDES = [(scale * x, scale * y) for x, y in STEEP_SIDES for scale in (0.999, 1.001)]


def along(*extrusion):
    tags = [
        Tag(code, str(float(value)), 1)
        for code, value in zip((210, 220, 230), extrusion, strict=True)
    ]
    return own_system(Entity("CIRCLE", 1, tags))


@pytest.mark.parametrize("up", [1, -1])
@pytest.mark.parametrize(("x", "y"), SIDES)
def test_the_x_axis_is_level_but_where_the_extrusion_is_nearly_upright(x, y, up):
    """It is z cross n; where n's x and y are both below a 64th, y cross n."""
    normal = np.array([x, y, up * np.sqrt(1 - x**2 - y**2)])
    place = along(*(7 * normal))
    upright = max(abs(x), abs(y)) < STEEP
    wanted = np.cross([0, 1, 0] if upright else [0, 0, 1], normal)
    np.testing.assert_allclose(place.axes[:, 0], wanted / np.linalg.norm(wanted), atol=1e-15)
    np.testing.assert_allclose(place.axes[:, 2], normal, atol=1e-15)
    np.testing.assert_allclose(place.axes.T @ place.axes, np.eye(3), atol=1e-15)
    assert np.linalg.det(place.axes) == pytest.approx(1)


@pytest.mark.parametrize("extrusion", [(0.0, 0.0, 0.3), (0.0, 0.0, 0.0), (1e200, 0.0, 1.0)])
def test_without_a_direction_to_lean_to_the_system_is_that_of_the_drawing(extrusion):
    np.testing.assert_array_equal(along(*extrusion).axes, np.eye(3))


def test_from_below_x_is_mirrored():
    np.testing.assert_array_equal(along(0.0, 0.0, -2.0).axes, np.diag([-1, 1, -1]))
