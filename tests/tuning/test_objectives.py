import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.simulation.metrics import Metrics
from tuning.objectives import (
    AtMost,
    mean_contour_error,
    mean_tracking_error,
    no_limits,
    worst_contour_error,
    worst_tracking_error,
)

NAMES = [name for name in Metrics.__dataclass_fields__ if name != "diverged"]
ERRORS = np.array([[1e-6, 4e-6], [3e-6, 2e-6]])


def metrics(**values):
    shape = (2, 2)
    return Metrics(
        **{name: jnp.broadcast_to(values.get(name, 1.0), shape) for name in NAMES},
        diverged=jnp.zeros(shape, bool),
    )


def test_objectives():
    there = metrics(rms_contour_error=jnp.asarray(ERRORS))
    np.testing.assert_allclose(mean_contour_error(there), [2.5e-6])
    np.testing.assert_allclose(worst_contour_error(there), ERRORS.ravel())
    behind = metrics(rms_tracking_error=jnp.asarray(ERRORS))
    np.testing.assert_allclose(mean_tracking_error(behind), [2.5e-6])
    np.testing.assert_allclose(worst_tracking_error(behind), ERRORS.ravel())
    assert no_limits(there).shape == (0,)


def test_limits_are_logarithms_for_every_contour_and_plant():
    limits = AtMost(rms_contour_error=2e-6, peak_control=0.5)
    np.testing.assert_allclose(
        limits(metrics(rms_contour_error=jnp.asarray(ERRORS))),
        [*np.log(ERRORS.ravel() / 2e-6), *[np.log(2)] * 4],
    )
    assert AtMost()(metrics()).shape == (0,)


def test_a_limit_has_a_slope_at_zero():
    slope = jax.grad(lambda u: jnp.sum(AtMost(rms_control=1.0)(metrics(rms_control=u))))(0.0)
    assert np.isfinite(slope)


@pytest.mark.parametrize("limit", [0.0, -1.0, np.nan])
def test_bad_limits_are_named(limit):
    with pytest.raises(ValueError, match="rms_control: a limit needs to be positive"):
        AtMost(rms_control=limit)


@pytest.mark.parametrize("name", ["contour", "diverged"])
def test_unknown_metrics_are_named(name):
    with pytest.raises(ValueError, match=f"{name}: there is no such metric.*rms_contour_error"):
        AtMost(**{name: 1.0})
