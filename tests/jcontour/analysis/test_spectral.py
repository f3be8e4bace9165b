import jax
import numpy as np
import pytest

from jcontour.analysis.spectral import radius

radius_of, with_slope = jax.jit(radius), jax.jit(jax.value_and_grad(radius))


@pytest.mark.parametrize("size", [1, 2, 7, 24])
def test_the_radius_and_its_slope(size):
    """By NumPy and central differences."""
    random = np.random.default_rng(size)
    M = random.standard_normal((size, size)) * 10.0 ** random.uniform(-3, 3, (size, 1))

    def by_numpy(M):
        return np.abs(np.linalg.eigvals(M)).max()

    assert float(radius_of(M)) == pytest.approx(by_numpy(M), rel=1e-12)
    step = 1e-6 * random.standard_normal((size, size)) * np.abs(M)
    found = np.sum(np.asarray(with_slope(M)[1]) * step)
    assert found == pytest.approx((by_numpy(M + step) - by_numpy(M - step)) / 2, rel=1e-6)


def test_a_double_eigenvalue_has_the_slope_of_one_of_them():
    slope = np.asarray(with_slope(np.diag([0.9, 0.9, 0.1]))[1])
    assert np.trace(slope) == pytest.approx(1.0) and abs(slope[2, 2]) < 1e-9


@pytest.mark.parametrize("M", [np.zeros((2, 2)), [[0.0, 1.0], [0.0, 0.0]]])
def test_a_nilpotent_matrix_has_no_radius_and_a_finite_slope(M):
    value, slope = with_slope(np.asarray(M))
    assert float(value) < 1e-7 and np.isfinite(slope).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_matrix_that_is_not_finite_has_an_infinite_radius(bad):
    value, slope = with_slope(np.array([[0.5, bad], [0.0, 0.1]]))
    assert np.isinf(value) and np.isfinite(slope).all()
