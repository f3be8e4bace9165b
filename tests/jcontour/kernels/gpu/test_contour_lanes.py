"""Distances in the lanes of a GPU against `Contour.nearest`; the kernel is interpreted here."""

import jax
import numpy as np
import pytest

from jcontour.geometry.contours import arc, chain, circle, line, polygon, polyline, stack
from jcontour.kernels.gpu.contour_lanes import LaneContour, contour_rows
from jcontour.kernels.gpu.lanes import Batch, Lanes, Operand, launch

CORNERS = [(0.0, 0.0), (5e-3, 0.0), (5e-3, 3e-3), (1e-3, -2e-3)]
WAY = chain([line([0.0, 0.0], [3e-3, 0.0]), arc([3e-3, 0.0], [3e-3, 2e-3], 2.0)])
RISE = polyline([(0.0, 0.0, 0.0), (2e-3, 0.0, 1e-3), (2e-3, 3e-3, 2e-3)])


def by_lanes(contour, point, at, reach):
    """Squared distances of points (N, m)."""
    count, m = point.shape
    fixed = contour_rows(jax.tree.map(Operand, jax.device_get(contour)))
    rows = [Operand(one.array.astype(float), one.axes).fixed() for one in fixed]
    seen = [Operand(array, (0,)) for array in (point.T, at[None], reach[None])]
    batch = Batch.of([*seen, *rows])

    def kernel(*refs):
        lanes = Lanes.of(0, 1, count, count)
        y, at, reach, *pieces = batch.rows(refs[:-1], lanes.member)
        path = LaneContour.read(pieces, m, contour.rate.size, contour.turns)
        value = path.square([y.fixed(a) for a in range(m)], at.fixed(0), reach.fixed(0))
        refs[-1][0, lanes.member] = value

    return np.asarray(launch(kernel, 1, [*seen, *rows], [(1, count)])[0])[0]


@pytest.mark.parametrize(
    "contour",
    [
        polygon([(0.0, 0.0), (2e-2, 0.0), (2e-2, 2e-2), (0.0, 2e-2)]),
        jax.tree.map(lambda leaf: np.asarray(leaf)[0], stack([WAY, polyline(CORNERS)])),
        pytest.param(polyline(CORNERS), marks=pytest.mark.slow),
        pytest.param(circle(2e-3), marks=pytest.mark.slow),
        pytest.param(RISE, marks=pytest.mark.slow),
        pytest.param(line([0.0], [1e-2]), marks=pytest.mark.slow),
    ],
    ids=["square", "padded arc", "corners", "circle", "three axes", "one axis"],
)
def test_distance_is_that_of_the_nearest_point(contour):
    random, length = np.random.default_rng(0), float(contour.length)
    at = random.uniform(-0.1, 1.1, 64) * length
    far = np.geomspace(1e-9, 1e-2, 64)
    point = np.asarray(contour.position(at)) + far[:, None] * random.standard_normal((64, 1))
    reach = np.where(np.arange(64) % 4 == 0, 0.0, random.uniform(0.0, 0.7, 64) * length)
    point[3] = np.nan
    found = by_lanes(contour, point, at, reach)
    nearest = contour.position(contour.nearest(point, at, reach))
    wanted = np.sum((point - np.asarray(nearest)) ** 2, axis=1)
    # of the contour's size: rounding of positions
    np.testing.assert_allclose(np.sqrt(found), np.sqrt(wanted), rtol=1e-12, atol=1e-15 * length)
    assert np.isnan(found[3])
    assert np.isfinite(np.delete(found, 3)).all()
