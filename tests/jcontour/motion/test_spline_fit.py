"""The spline against the dense least squares of NumPy."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from jcontour.motion.spline_fit import DEGREE, fitted_spline


def fit(tangents=(None, None), cells=4, samples=60, axes=2):
    random = np.random.default_rng(cells)
    knots = np.sort(np.append([0.0, 1.0], random.uniform(0.1, 0.9, cells - 1)))
    arc = np.sort(np.append([0.0, 1.0], random.uniform(0.0, 1.0, samples - 2)))
    points = random.normal(size=(samples, axes))
    return fitted_spline(knots, arc, points, tangents), arc, points


@pytest.mark.parametrize("cells", [1, 2, 7])
@pytest.mark.parametrize("begins", [False, True])
@pytest.mark.parametrize("ends", [False, True])
def test_the_distance_is_least_under_the_conditions_at_its_ends(cells, begins, ends):
    """What is free is that of `lstsq`; what is not keeps ends and directions.

    Every point counts as much as the path that is nearest to it.
    """
    before = np.array([0.6, 0.8]) if begins else None
    after = np.array([0.0, -1.0]) if ends else None
    spline, arc, points = fit((before, after), cells)
    np.testing.assert_allclose(spline([0.0, 1.0]), points[[0, -1]], atol=1e-12)
    for place, direction in ((0.0, before), (1.0, after)):
        if direction is not None:
            np.testing.assert_allclose(spline(place, 1), direction, atol=1e-11)
    dense = BSpline.design_matrix(arc, spline.t, DEGREE).toarray()
    free = slice(1 + begins, dense.shape[1] - 1 - ends)
    fixed = spline.c.copy()
    fixed[free] = 0.0
    middle = 0.5 * (arc[1:] + arc[:-1])
    weight = np.sqrt(np.diff(middle, prepend=0.0, append=1.0))[:, None]
    left = points - dense @ fixed
    best = np.linalg.lstsq(weight * dense[:, free], weight * left, rcond=None)[0]
    np.testing.assert_allclose(spline.c[free], best, atol=1e-9)


def test_a_quintic_is_found_again_where_intervals_have_few_points():
    knots = np.array([0.0, 0.1, 0.11, 0.5, 1.0])  # one interval has no point
    arc = np.concatenate([np.linspace(0.0, 0.1, 9), np.linspace(0.12, 1.0, 20)])
    curve = np.polynomial.Polynomial([0.3, -1.0, 2.0, 0.5, -4.0, 1.5])
    points = np.stack([curve(arc), -2 * curve(arc)], axis=1)
    spline = fitted_spline(knots, arc, points, (None, None))
    np.testing.assert_allclose(spline(arc), points, atol=1e-11)


def test_points_that_do_not_determine_it_are_refused():
    knots = np.linspace(0.0, 1.0, 20)
    arc = np.array([0.0, 0.01, 0.02, 1.0])
    with pytest.raises(np.linalg.LinAlgError):
        fitted_spline(knots, arc, np.ones((4, 2)), (None, None))
