import numpy as np
import pytest
from scipy.signal import StateSpace, dlsim, lti

from tuning.identification.flexible_axis.encoder_noise import encoder_noise, noise_correlation

K, C, DT = 7652.0, 5.5, 1e-3


def rung(random, rows):
    """Unit white noise through G, by SciPy's exact discretisation of the link."""
    link = lti([C, K], [1, C, K]).to_ss()
    sampled = StateSpace(link.A, link.B, link.C, link.D).to_discrete(DT, method="bilinear")
    return dlsim(sampled, random.normal(size=rows))[1][:, 0]


@pytest.mark.parametrize(("motor", "tool"), [(4e-7, 4e-7), (1e-6, 3e-7), (2e-7, 2e-6)])
def test_tells_the_two_noises_apart(motor, tool):
    random, rows = np.random.default_rng(6), 40_000
    residual = motor * rung(random, rows) + tool * random.normal(size=rows)
    found = encoder_noise(residual, DT, np.array([K, C]))
    np.testing.assert_allclose(found, [motor, tool], rtol=0.15)


def test_correlation_is_that_of_noise_through_the_link():
    """Sums over the impulse response of the link give the autocorrelation, without a spectrum."""
    rows, impulse = 4000, np.zeros(4000)
    impulse[0] = 1.0
    link = lti([C, K], [1, C, K]).to_ss()
    response = dlsim(
        StateSpace(link.A, link.B, link.C, link.D).to_discrete(DT, method="bilinear"), impulse
    )[1][:, 0]
    expected = np.array([response[: rows - lag] @ response[lag:] for lag in range(200)])
    found = noise_correlation(np.array([1.0, 0.0]), DT, np.array([K, C]), rows)[:200]
    np.testing.assert_allclose(found, expected, atol=0.01 * expected[0])
    white = noise_correlation(np.array([0.0, 2.0]), DT, np.array([K, C]), rows)
    np.testing.assert_allclose(white, [4.0, *np.zeros(rows - 1)], atol=1e-12)
