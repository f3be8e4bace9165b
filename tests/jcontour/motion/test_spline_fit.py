"""The splines against the dense least squares of NumPy, one by one."""

import numpy as np
import pytest
from numpy.polynomial import polynomial
from scipy.interpolate import BSpline

from jcontour.motion.spline_fit import DEGREE, fitted_splines

NONE = np.full(2, np.nan)


class Case:
    """Random knots and points from 0 to 1."""

    def __init__(self, cells: int, before=NONE, after=NONE, samples: int = 60):
        random = np.random.default_rng(cells)
        self.knots = np.sort(np.append([0.0, 1.0], random.uniform(0.1, 0.9, cells - 1)))
        self.arc = np.sort(np.append([0.0, 1.0], random.uniform(0.0, 1.0, samples - 2)))
        self.points = random.normal(size=(samples, 2))
        self.weight = random.uniform(0.5, 2.0, samples)
        self.tangents = np.array([before, after])

    def whole(self):
        """The knots, those at both ends sixfold."""
        return np.concatenate([np.zeros(DEGREE), self.knots, np.ones(DEGREE)])

    def best(self):
        """Coefficients by `lstsq`, ends and directions kept."""
        dense = BSpline.design_matrix(self.arc, self.whole(), DEGREE).toarray()
        begins, ends = ~np.isnan(self.tangents[:, 0])
        free = slice(1 + begins, dense.shape[1] - 1 - ends)
        actual = np.zeros((dense.shape[1], 2))
        actual[[0, -1]] = self.points[[0, -1]]
        if begins:
            actual[1] = actual[0] + self.tangents[0] * self.knots[1] / DEGREE
        if ends:
            actual[-2] = actual[-1] - self.tangents[1] * (1 - self.knots[-2]) / DEGREE
        root = np.sqrt(self.weight)[:, None]
        left = root * (self.points - dense @ actual)
        actual[free] = np.linalg.lstsq(root * dense[:, free], left, rcond=None)[0]
        return actual


def fitted(cases, begins):
    """Splines of cases that begin there on one parameter."""
    places = [at + case.arc for at, case in zip(begins, cases, strict=True)]
    for place in places:
        place[-1] = np.nextafter(place[-1], 0.0)
    knots = np.concatenate([at + case.knots for at, case in zip(begins, cases, strict=True)])
    powers, determined = fitted_splines(
        knots,
        np.array([case.knots.size for case in cases]),
        np.concatenate(places),
        np.concatenate([case.points for case in cases]),
        np.concatenate([case.weight for case in cases]),
        np.stack([case.tangents for case in cases], axis=1),
    )

    def spline(place, derivative=0):
        cell = np.searchsorted(knots, place, side="right") - 1
        rows = np.moveaxis(polynomial.polyder(powers, derivative, axis=1)[cell], -2, 0)
        return polynomial.polyval((place - knots[cell])[..., None], rows, tensor=False)

    return spline, determined


@pytest.mark.parametrize("cells", [1, 2, 7])
@pytest.mark.parametrize("before", [NONE, np.array([0.6, 0.8])])
@pytest.mark.parametrize("after", [NONE, np.array([0.0, -1.0])])
def test_the_distance_is_least_under_the_conditions_at_its_ends(cells, before, after):
    case = Case(cells, before, after)
    spline, determined = fitted([case], [0.0])
    assert determined.all()
    inner = np.nextafter(1.0, 0.0)
    place, best = np.linspace(0.0, inner, 101), BSpline(case.whole(), case.best(), DEGREE)
    for derivative in (0, 1):
        np.testing.assert_allclose(
            spline(place, derivative), best(place, derivative), rtol=1e-9, atol=1e-8
        )
    np.testing.assert_allclose(spline(np.array([0.0, inner])), case.points[[0, -1]], atol=1e-12)
    for place, direction in ((0.0, before), (inner, after)):
        if not np.isnan(direction).any():
            np.testing.assert_allclose(spline(place, 1), direction, atol=1e-11)


def test_splines_behind_each_other_do_not_meet():
    """The second begins where the first ends, the third after a gap."""
    cases, begins = [Case(3), Case(1, after=np.array([0.0, -1.0])), Case(5)], [0.0, 1.0, 2.5]
    spline, determined = fitted(cases, begins)
    assert determined.all()
    for case, begin in zip(cases, begins, strict=True):
        alone = BSpline(case.whole(), case.best(), DEGREE)
        place = np.linspace(0.0, np.nextafter(1.0, 0.0), 101)
        np.testing.assert_allclose(spline(begin + place[:-1]), alone(place[:-1]), atol=1e-8)
        end = np.nextafter(begin + 1.0, 0.0)
        np.testing.assert_allclose(spline(end), alone(place[-1]), atol=1e-8)


def test_a_quintic_is_found_again_where_intervals_have_few_points():
    case = Case(4)
    case.knots = np.array([0.0, 0.1, 0.11, 0.5, 1.0])  # one interval has no point
    case.arc = np.concatenate([np.linspace(0.0, 0.1, 9), np.linspace(0.12, 1.0, 20)])
    curve = np.polynomial.Polynomial([0.3, -1.0, 2.0, 0.5, -4.0, 1.5])
    case.points, case.weight = np.stack([curve(case.arc), -2 * curve(case.arc)], axis=1), case.arc
    spline, _ = fitted([case], [0.0])
    np.testing.assert_allclose(spline(case.arc[:-1]), case.points[:-1], atol=1e-11)


def test_points_that_do_not_determine_a_spline_leave_the_others():
    poor = Case(3, samples=4)
    poor.knots = np.linspace(0.0, 1.0, 20)
    cases = [Case(3), poor, Case(2), poor, Case(1)]
    spline, determined = fitted(cases, 2.0 * np.arange(5))
    np.testing.assert_array_equal(determined, [True, False, True, False, True])
    for k in np.flatnonzero(determined):
        alone = BSpline(cases[k].whole(), cases[k].best(), DEGREE)
        place = np.linspace(0.0, 0.99, 50)
        np.testing.assert_allclose(spline(2.0 * k + place), alone(place), atol=1e-8)
