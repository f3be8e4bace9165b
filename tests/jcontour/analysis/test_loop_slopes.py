import numpy as np
import pytest

from jcontour.analysis.frozen_loops import dominant, real_outer


def radius_and_slope(M):
    actual = dominant(np.asarray(M, float))
    return float(actual.radius), real_outer(actual.left, actual.right)


@pytest.mark.parametrize("size", [1, 2, 7, 24])
def test_the_radius_and_its_slope(size):
    """By NumPy and central differences."""
    random = np.random.default_rng(size)
    M = random.standard_normal((size, size)) * 10.0 ** random.uniform(-3, 3, (size, 1))

    def by_numpy(M):
        return np.abs(np.linalg.eigvals(M)).max()

    radius, slope = radius_and_slope(M)
    assert radius == pytest.approx(by_numpy(M), rel=1e-12)
    step = 1e-6 * random.standard_normal((size, size)) * np.abs(M)
    wanted = (by_numpy(M + step) - by_numpy(M - step)) / 2
    assert np.sum(slope * step) == pytest.approx(wanted, rel=1e-6)


def test_a_double_eigenvalue_has_the_slope_of_one_of_them():
    _, slope = radius_and_slope(np.diag([0.9, 0.9, 0.1]))
    assert np.trace(slope) == pytest.approx(1.0) and abs(slope[2, 2]) < 1e-9


@pytest.mark.parametrize("M", [np.zeros((2, 2)), [[0.0, 1.0], [0.0, 0.0]]])
def test_a_nilpotent_matrix_has_no_radius_and_a_finite_slope(M):
    radius, slope = radius_and_slope(M)
    assert radius < 1e-7 and np.isfinite(slope).all()
