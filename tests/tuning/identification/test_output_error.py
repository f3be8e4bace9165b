import jax.numpy as jnp
import numpy as np
from scipy.optimize import curve_fit

from tuning.identification.output_error import output_error


def _residual(shared, own, time, recorded):
    return shared[0] * jnp.exp(-shared[1] * time) + own[0] - recorded


def test_two_decays_with_offsets_of_their_own():
    """Against SciPy's curve_fit over both records in one function."""
    random, time = np.random.default_rng(4), np.linspace(0, 2, 80)
    recorded = [
        3 * np.exp(-1.5 * time) + offset + 0.01 * random.normal(size=80) for offset in (0.2, -1.0)
    ]
    fit = output_error(
        _residual, [(time, r) for r in recorded], np.array([1.0, 1.0]), np.zeros((2, 1))
    )

    def both(_, a, b, first, second):
        return np.concatenate([a * np.exp(-b * time) + first, a * np.exp(-b * time) + second])

    values, covariance = curve_fit(both, None, np.concatenate(recorded), [1.0, 1.0, 0.0, 0.0])
    assert fit.converged
    np.testing.assert_allclose(fit.shared, values[:2], rtol=1e-6)
    freedom = 160 / (160 - 4)  # curve_fit divides the squares by the degrees of freedom
    white = np.mean(np.concatenate(fit.residuals) ** 2) * freedom
    np.testing.assert_allclose(
        fit.covariance([np.array([white])] * 2), covariance[:2, :2], rtol=1e-4
    )


def test_a_record_of_another_length():
    short, long = np.linspace(0, 1, 20), np.linspace(0, 3, 70)
    signals = [(t, 2 * np.exp(-0.7 * t) + offset) for t, offset in ((short, 1.0), (long, 0.0))]
    fit = output_error(_residual, signals, np.array([1.0, 1.0]), np.zeros((2, 1)))
    np.testing.assert_allclose(fit.shared, [2.0, 0.7], rtol=1e-7)
    assert [J.shape for J in fit.slopes] == [(20, 4), (70, 4)] and not fit.slopes[0][:, 3].any()
