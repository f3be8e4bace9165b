import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.simulation.metrics import Metrics
from tuning.objectives import (
    AtMost,
    Before,
    Entry,
    LoopPeaks,
    Outcome,
    mean_contour_error,
    mean_tracking_error,
    no_limits,
    typical_contour_error,
    typical_tracking_error,
    worst_contour_error,
    worst_increment,
    worst_tracking_error,
)

NAMES = [name for name in Metrics.__dataclass_fields__ if name != "diverged"]
ERRORS = np.array([[1e-6, 4e-6], [3e-6, 2e-6]])
PEAKS = np.array([[1.5, 3.0], [2.0, 1.2], [1.1, 1.4]])


def metrics(**values):
    ones = dict.fromkeys(NAMES, np.ones((2, 2)))
    return Metrics(**(ones | values), diverged=np.zeros((2, 2), bool))


def outcome(**values):
    return Outcome(metrics(**values), LoopPeaks(PEAKS, PEAKS / 2, PEAKS / 4, PEAKS / 8))


@pytest.mark.parametrize(
    ("error", "mean", "worst", "typical"),
    [
        ("contour", mean_contour_error, worst_contour_error, typical_contour_error),
        ("tracking", mean_tracking_error, worst_tracking_error, typical_tracking_error),
    ],
)
def test_objectives_return_rows(error, mean, worst, typical):
    there = Outcome(metrics(**{f"rms_{error}_error": ERRORS}))
    np.testing.assert_allclose(mean(there), [[2.5e-6]])
    np.testing.assert_allclose(worst(there), ERRORS.reshape(1, 4))
    np.testing.assert_allclose(typical(there), ERRORS)
    assert no_limits(there).shape == (0,)


def test_the_largest_increment_is_an_objective():
    there = Outcome(metrics(rms_increment=ERRORS))
    np.testing.assert_allclose(worst_increment(there), ERRORS.reshape(1, 4))


def test_limits_are_logarithms_for_every_contour_and_plant():
    limits = AtMost(rms_contour_error=2e-6, peak_control=0.5)
    np.testing.assert_allclose(
        limits(outcome(rms_contour_error=ERRORS)),
        [*np.log(ERRORS.ravel() / 2e-6), *[np.log(2)] * 4],
    )
    assert AtMost()(outcome()).shape == (0,)


def test_loops_are_limited_for_every_probe_and_plant():
    limits = AtMost(peak_sensitivity=2.0, rms_control=1.0, peak_complementary_sensitivity=1.0)
    np.testing.assert_allclose(
        limits(outcome()), [*np.log(PEAKS.ravel() / 2), *[0.0] * 4, *np.log(PEAKS.ravel() / 2)]
    )


def test_entries_name_limit_row_and_plant_in_the_order_of_the_vector():
    limits = AtMost(peak_sensitivity=2.0, rms_control=1.0)
    entries = limits.entries(outcome())
    assert len(entries) == limits(outcome()).size == 10
    assert entries[1] == Entry("peak_sensitivity", 0, 1)
    assert entries[5] == Entry("peak_sensitivity", 2, 1)
    assert entries[-1] == Entry("rms_control", 1, 1)


def test_a_limit_has_a_slope_at_zero():
    limits = AtMost(rms_control=1.0)
    slope = jax.grad(lambda u: jnp.sum(limits(outcome(rms_control=u * np.ones((2, 2))))))
    assert np.isfinite(jax.jit(slope)(0.0))


@pytest.mark.parametrize("limit", [0.0, -1.0, np.nan])
def test_bad_limits_are_named(limit):
    with pytest.raises(ValueError, match="rms_control: a limit needs to be positive"):
        AtMost(rms_control=limit)


def test_no_loop_has_a_peak_sensitivity_of_one():
    with pytest.raises(ValueError, match="peak_sensitivity: a limit needs to be above 1"):
        AtMost(peak_sensitivity=1.0)


def test_loops_with_more_delay_are_limited_for_every_probe_and_plant():
    late = np.array([[0.5, 2.0]])
    limits = AtMost(late_radius=0.5)
    np.testing.assert_allclose(limits(Outcome(metrics(), late=late)), [0.0, np.log(4.0)])
    assert limits.entries(Outcome(metrics(), late=late))[1] == Entry("late_radius", 0, 1)
    with pytest.raises(ValueError, match="late_radius: needs a problem that looks at loops"):
        limits(Outcome(metrics()))


def test_errors_are_limited_by_those_before_the_tuning():
    """A contour that nothing is asked of, infinite before, has no slope and no excess."""
    before = Before(placed(np.array([2e-6, np.inf])))
    limits = AtMost(before, error_ratio=0.5)
    bounds = np.asarray(limits(outcome(rms_contour_error=ERRORS))).reshape(ERRORS.shape)
    np.testing.assert_allclose(bounds[0], np.log(ERRORS[0] / 1e-6), rtol=1e-12)
    assert (bounds[1] < -60).all()
    slope = jax.jit(jax.jacfwd(lambda e: limits(outcome(rms_contour_error=e))))(ERRORS)
    slope = np.asarray(slope)
    np.testing.assert_allclose(slope[0, 0, 0], 1 / ERRORS[0, 0], rtol=1e-12)
    assert np.isfinite(slope).all() and not slope[ERRORS.shape[1] :].any()


def test_the_ratio_of_a_contour_is_to_its_own_error():
    before = Before(placed(np.array([2e-6, 3e-6])), "tracking")
    limits = AtMost(before, error_ratio=1.0)
    bounds = np.asarray(limits(Outcome(metrics(rms_tracking_error=np.full((2, 2), 6e-6)))))
    np.testing.assert_allclose(np.sort(bounds), np.log([2.0, 2.0, 3.0, 3.0]), rtol=1e-12)


def test_a_ratio_needs_the_errors_before():
    with pytest.raises(ValueError, match="error_ratio: needs the errors before the tuning"):
        AtMost(error_ratio=1.0)


def test_limits_on_loops_need_loops():
    with pytest.raises(ValueError, match="peak_sensitivity: .* needs a problem with windows"):
        AtMost(peak_sensitivity=2.0)(Outcome(metrics()))


@pytest.mark.parametrize("name", ["contour", "diverged"])
def test_unknown_names_are_told(name):
    with pytest.raises(ValueError, match=f"{name}: there is no such metric.*rms_contour_error"):
        AtMost(**{name: 1.0})


def test_the_noise_of_counts_is_limited_for_every_probe_and_plant():
    limits, noise = AtMost(count_noise=0.1), np.array([[0.1, 0.05]])
    bounds = limits(Outcome(metrics(), count_noise=noise))
    np.testing.assert_allclose(bounds, [0.0, -np.log(2.0)], atol=1e-12)
    with pytest.raises(ValueError, match="count_noise: needs a problem that looks at the noise"):
        limits(Outcome(metrics()))


def outcome_outcome(lost, radii):
    metrics = Metrics(
        **{name: jnp.ones((1, 2)) for name in Metrics.__dataclass_fields__ if name != "diverged"},
        diverged=np.asarray([[False, lost]]),
    )
    loops = (
        None
        if radii is None
        else LoopPeaks(jnp.ones(2), jnp.ones(2), jnp.asarray(radii), jnp.zeros(2))
    )
    return Outcome(metrics, loops)


@pytest.mark.parametrize(
    ("lost", "radii", "wanted"),
    [
        (False, None, False),
        (True, None, True),
        (False, [0.5, 0.999], False),
        (False, [0.5, 1 - 1e-7], False),
        (False, [0.5, 1 - 3e-9], True),  # a controller with such an observer cannot be built
        (False, [0.5, np.nan], True),
        (True, [0.5, 0.5], True),
    ],
)
def test_a_run_that_leaves_or_an_unstable_loop_is_divergence(lost, radii, wanted):
    assert bool(outcome_outcome(lost, radii).diverged) is wanted
