import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tuning.identification.flexible_axis.records import Record
from tuning.identification.flexible_axis.winding import _linear, fit_winding

R, L, K_E, DT = 8.0, 6e-3, 30.0, 2e-4


def electrical_test(noise=0.0, offset=0.0, seed=0, rows=1500):
    """A motor that swings at 5 Hz while the voltage jumps at random.

    (3.4) is integrated row by row, by an adaptive integrator.
    """
    random = np.random.default_rng(seed)
    voltage = np.repeat(random.uniform(-30, 30, rows // 25), 25)
    amplitude, pace = 0.01, 2 * np.pi * 5
    current = [0.7]
    for k, u in enumerate(voltage[:-1]):
        step = solve_ivp(
            lambda t, i, u=u: (u - R * i - K_E * amplitude * pace * np.cos(pace * t)) / L,
            (k * DT, (k + 1) * DT),
            current[-1:],
            rtol=1e-10,
            atol=1e-12,
        )
        current.append(step.y[0, -1])
    motor = amplitude * np.sin(pace * DT * np.arange(rows))
    return Record(
        "electrical",
        DT,
        motor,
        np.array(current) + noise * random.normal(size=rows),
        voltage=voltage + offset,
    )


@pytest.fixture(scope="module")
def clean():
    return electrical_test(offset=0.3)


def test_recovers_the_winding(clean):
    """A speed that varies within a row is not its mean: 1e-5 of the back EMF at this rate."""
    fit = fit_winding([clean, clean])
    np.testing.assert_allclose(fit.estimate.values, [R, L, K_E], rtol=1e-5)
    assert (
        fit.estimate.names == ("resistance", "inductance", "back_emf")
        and max(abs(r).max() for r in fit.residuals) < 1e-3
    )


def test_the_search_begins_near_the_winding(clean):
    """From the voltage integrated over every row, the current straight between two."""
    np.testing.assert_allclose(_linear([clean]), [R, L, K_E, 0.3], rtol=0.02)


def test_noise_in_the_current_does_no_harm(clean):
    """12 realisations: no bias, and deviations as large as promised."""
    random, errors = np.random.default_rng(3), []
    for _ in range(12):
        fit = fit_winding(
            [clean._replace(current=clean.current + 0.05 * random.normal(size=clean.rows))]
        )
        errors.append(
            (fit.estimate.values - [R, L, K_E]) / np.sqrt(np.diag(fit.estimate.covariance))
        )
    assert np.all(np.abs(np.mean(errors, axis=0)) < 3 / np.sqrt(12))
    assert np.all((np.std(errors, axis=0) > 0.4) & (np.std(errors, axis=0) < 1.6))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"voltage": None}, "no test with a voltage"),
        ({"motor": np.zeros(1500)}, "electrical: the motor position is constant"),
        ({"current": np.ones(1500)}, "electrical: the current is constant"),
        ({"current_d": np.ones(1500)}, "current_d is .* % of current_q"),
    ],
)
def test_what_cannot_be_fitted(clean, change, message):
    with pytest.raises(ValueError, match=message):
        fit_winding([clean._replace(**change)])


def test_wrong_signs(clean):
    with pytest.raises(ValueError, match="check signs and units"):
        fit_winding([clean._replace(current=-clean.current)])
