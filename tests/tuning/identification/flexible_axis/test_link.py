import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tuning.identification.flexible_axis.link import _residual, _signals, fit_link
from tuning.identification.flexible_axis.records import Record

DT = 1e-3


def swung(stiffness, damping, rows=1200, offset=2e-4, noise=0.0, seed=0):
    """A motor on a smooth path, x = 0.05 (1 - cos 4 t) + 1 mm sin 31 t.

    The end effector follows (3.2), by an adaptive integrator.
    """

    def motor(t):
        return 0.05 * (1 - np.cos(4 * t)) + 1e-3 * np.sin(31 * t), 0.2 * np.sin(
            4 * t
        ) + 31e-3 * np.cos(31 * t)

    def rates(t, x):
        position, speed = motor(t)
        return [x[1], stiffness * (position - x[0]) + damping * (speed - x[1])]

    time = DT * np.arange(rows)
    tool = (
        solve_ivp(rates, (0, time[-1]), [1e-3, 0.0], t_eval=time, rtol=1e-11, atol=1e-14).y[0]
        + offset
    )
    random = np.random.default_rng(seed)
    return Record(
        "moves",
        DT,
        motor(time)[0] + noise * random.normal(size=rows),
        np.zeros(rows),
        tool + noise * random.normal(size=rows),
    )


def test_the_motion_itself_leaves_next_to_nothing():
    """To what a cubic spline loses of the motor's path."""
    record = swung(7652.6, 5.526)
    own = np.array([2e-4, 1e-3, -31e-3])  # offset, and how the end effector begins
    left = jax.jit(_residual)(np.array([7652.6, 5.526]), own, *_signals(record))
    assert np.abs(left).max() < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stiffness", "damping"), [(7652.6, 5.526), (400.0, 2.0), (60_000.0, 30.0)]
)
def test_recovers_resonances_from_3_to_40_hz(stiffness, damping):
    """To what a cubic spline loses of the motor's path."""
    fit = fit_link([swung(stiffness, damping)])
    np.testing.assert_allclose(fit.estimate.values, [stiffness, damping], rtol=1e-5)
    assert abs(fit.residuals[0]).max() < 1e-8


@pytest.mark.slow
def test_intervals_under_noise_on_both_encoders():
    """12 realisations: no bias, and deviations as large as promised."""
    errors = []
    for seed in range(12):
        fit = fit_link([swung(7652.6, 5.526, noise=5e-7, seed=100 + seed)])
        errors.append(
            (fit.estimate.values - [7652.6, 5.526]) / np.sqrt(np.diag(fit.estimate.covariance))
        )
    assert np.all(np.abs(np.mean(errors, axis=0)) < 3 / np.sqrt(12))
    assert np.all((np.std(errors, axis=0) > 0.4) & (np.std(errors, axis=0) < 1.6))


def test_what_cannot_be_fitted():
    record = swung(7652.6, 5.526, rows=300)
    assert record.tool is not None
    with pytest.raises(ValueError, match="tool_position: no test has the end effector"):
        fit_link([record._replace(tool=None)])
    with pytest.raises(ValueError, match="moves: the motor does not move"):
        fit_link([record._replace(motor=np.zeros(300))])
    with pytest.raises(ValueError, match="moves: the end effector against the motor does not move"):
        fit_link([record._replace(tool=record.motor)])
