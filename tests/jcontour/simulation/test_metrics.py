import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jcontour.geometry.contours import circle, line
from jcontour.motion.references import along, pad
from jcontour.simulation.metrics import score_signals

T, STEP, RADIUS = 12, 1e-4, 1e-3
NO_CONTROL = np.zeros((T, 2))
score = eqx.filter_jit(score_signals)


@pytest.fixture(scope="module")
def straight():
    return along(line([0, 0], [3e-3, 4e-3]), STEP * np.arange(T), 1e-3, 2, at_rest=False)


@pytest.fixture(scope="module")
def bent():
    return along(circle(RADIUS), STEP * np.arange(T), 1e-3, 2, at_rest=False)


def masked(reference, mask):
    return eqx.tree_at(lambda r: r.mask, reference, np.asarray([*mask, False, False]))


def desired(reference):
    return np.array(reference.position)[: reference.steps]


def test_constant_offset_from_a_line(straight):
    """3 um ahead and 4 um aside: the contour error is what is aside."""
    tangent, normal = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    metrics = score(desired(straight) + 3e-6 * tangent + 4e-6 * normal, NO_CONTROL, straight)
    for name, value in {"contour": 4e-6, "projected": 4e-6, "tracking": 5e-6}.items():
        assert float(getattr(metrics, f"rms_{name}_error")) == pytest.approx(value, rel=1e-9)
        assert float(getattr(metrics, f"peak_{name}_error")) == pytest.approx(value, rel=1e-9)
    assert float(metrics.duration) == pytest.approx(T * 1e-3)
    assert not metrics.diverged


def test_lag_and_radial_offset_on_a_circle(bent):
    """A tool behind by 0.02 rad and 5 um outside has a true contour error of 5 um.

    Tracking and projected error are by trigonometry.
    """
    lag, out = 0.02, RADIUS + 5e-6
    angle = np.arange(T) * STEP / RADIUS - lag
    metrics = score(out * np.stack([np.cos(angle), np.sin(angle)], -1), NO_CONTROL, bent)
    assert float(metrics.peak_contour_error) == pytest.approx(5e-6, rel=1e-8)
    assert float(metrics.rms_projected_error) == pytest.approx(
        abs(out * np.cos(lag) - RADIUS), rel=1e-8
    )
    assert float(metrics.rms_tracking_error) == pytest.approx(
        np.hypot(out * np.cos(lag) - RADIUS, out * np.sin(lag)), rel=1e-8
    )


def test_control_and_increment(straight):
    control = np.random.default_rng(0).standard_normal((T, 2))
    metrics = score(desired(straight), control, straight)
    size, increment = (
        np.linalg.norm(control, axis=1),
        np.linalg.norm(np.diff(control, axis=0), axis=1),
    )
    assert float(metrics.rms_control) == pytest.approx(np.sqrt(np.mean(size**2)))
    assert float(metrics.peak_control) == pytest.approx(size.max())
    assert float(metrics.rms_increment) == pytest.approx(np.sqrt(np.mean(increment**2)))
    assert float(metrics.peak_increment) == pytest.approx(increment.max())


@settings(max_examples=25)
@given(st.lists(st.booleans(), min_size=T, max_size=T), st.integers(0, 2**32 - 1))
def test_only_scored_samples_count_and_increments_do_not_cross_masks(bent, mask, seed):
    random, mask = np.random.default_rng(seed), np.array(mask)
    error, control = 1e-6 * random.standard_normal((T, 2)), random.standard_normal((T, 2))
    metrics = score(desired(bent) + error, control, masked(bent, mask))
    pairs = mask[1:] & mask[:-1]
    increment = np.linalg.norm(np.diff(control, axis=0), axis=1)[pairs]
    tracking = np.linalg.norm(error, axis=1)[mask]

    def rms(values):
        return np.sqrt(np.mean(values**2)) if values.size else 0.0

    assert float(metrics.rms_tracking_error) == pytest.approx(rms(tracking), rel=1e-9)
    assert float(metrics.peak_tracking_error) == pytest.approx(tracking.max(initial=0.0), rel=1e-9)
    assert float(metrics.rms_increment) == pytest.approx(rms(increment), rel=1e-9)
    assert float(metrics.peak_increment) == pytest.approx(increment.max(initial=0.0), rel=1e-9)
    assert float(metrics.duration) == pytest.approx(mask.sum() * 1e-3)
    assert not metrics.diverged


def test_window_is_a_mask(bent):
    random = np.random.default_rng(1)
    error, control = random.standard_normal((2, T, 2))
    output = desired(bent) + 1e-6 * error
    inside = (np.arange(T) >= 3) & (np.arange(T) < 9)
    by_window, by_mask = (
        score(output, control, bent, (3, 9)),
        score(output, control, masked(bent, inside)),
    )
    for actual, wanted in zip(jax.tree.leaves(by_window), jax.tree.leaves(by_mask), strict=True):
        assert float(actual) == float(wanted)
    for window in ((5, 5), (-1, 4), (0, T + 1), (6, 3)):
        with pytest.raises(ValueError, match="window: needs whole numbers 0 <= a < b <= 12"):
            score_signals(output, control, bent, window)


def test_a_window_of_parts_of_samples_is_refused(bent, any_type):
    with pytest.raises(ValueError, match="window: needs whole numbers 0 <= a < b <= 12"):
        score_signals(desired(bent), np.zeros((T, 2)), bent, (1.5, 9))


def test_padding_changes_no_metric(bent):
    random = np.random.default_rng(2)
    error, control = random.standard_normal((2, T, 2))
    output = desired(bent) + 1e-6 * error
    longer = pad(bent, T + 5)
    for garbage in (1.0, np.nan, np.inf):
        extra = np.full((5, 2), garbage)
        padded = score(np.concatenate([output, extra]), np.concatenate([control, extra]), longer)
        for actual, wanted in zip(
            jax.tree.leaves(padded), jax.tree.leaves(score(output, control, bent)), strict=True
        ):
            np.testing.assert_allclose(actual, wanted, rtol=1e-14)


@pytest.mark.parametrize("what", ["nan", "inf", "far", "control"])
def test_divergence_is_told(what, bent):
    output, control = desired(bent), NO_CONTROL.copy()
    size = 2 * np.sqrt(2) * RADIUS  # the diagonal of the bounding box
    output[5] += {"nan": np.nan, "inf": np.inf, "far": [1.001 * size, 0], "control": 0}[what]
    control[5] += np.nan if what == "control" else 0.0
    assert score(output, control, bent).diverged
    assert not score(output, control, bent, (0, 5)).diverged
    assert not score(output, control, masked(bent, np.arange(T) != 5)).diverged
    near = desired(bent)
    near[5] += [0.999 * size, 0]
    assert not score(near, NO_CONTROL, bent).diverged


@pytest.mark.parametrize(
    "mask", [np.ones(T, bool), np.arange(T) % 3 > 0, np.zeros(T, bool)], ids=["all", "some", "none"]
)
def test_gradients_are_finite_at_zero_error(mask, bent):
    @eqx.filter_jit
    @jax.grad
    def slope(signals):
        metrics = score_signals(*signals, masked(bent, mask))
        return sum(
            jnp.sum(leaf) for leaf in jax.tree.leaves(eqx.filter(metrics, eqx.is_inexact_array))
        )

    assert all(np.isfinite(leaf).all() for leaf in slope((desired(bent), NO_CONTROL)))


def test_gradients_are_finite_when_padding_is_not(bent):
    longer = pad(bent, T + 2)

    @eqx.filter_jit
    @jax.grad
    def slope(output):
        return score_signals(output, jnp.zeros((T + 2, 2)), longer).rms_contour_error

    output = np.concatenate([desired(bent) + 1e-6, np.full((2, 2), np.nan)])
    actual = np.asarray(slope(output))
    assert np.isfinite(actual[:T]).all()
    assert not np.any(np.nan_to_num(actual[T:]))


def test_gradient_of_the_contour_error_is_that_of_differences(bent):
    random = np.random.default_rng(3)
    error, change = random.standard_normal((2, T, 2))
    output = desired(bent) + 5e-6 * error
    rms = lambda y: score(y, NO_CONTROL, bent).rms_contour_error  # noqa: E731
    slope = np.sum(np.asarray(jax.jit(jax.grad(rms))(output)) * change)
    h = 1e-9
    assert slope == pytest.approx(
        (float(rms(output + h * change)) - float(rms(output - h * change))) / (2 * h), rel=1e-5
    )


def test_many_runs_at_once_are_each_scored(bent):
    random = np.random.default_rng(5)
    output = desired(bent)[:, None] + 1e-6 * random.standard_normal((T, 3, 2))
    output[5, 2] = np.nan
    control = random.standard_normal((T, 3, 2))
    together = score(output, control, bent, (1, 9))
    for k in range(3):
        alone = score(output[:, k], control[:, k], bent, (1, 9))
        for actual, wanted in zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True):
            np.testing.assert_allclose(actual[k], wanted, rtol=1e-14)


def test_metrics_are_printed_with_their_units(straight):
    """5 um ahead on a straight: no contour error, and 5 um of tracking error."""
    ahead = desired(straight) + 5e-6 * np.array([0.6, 0.8])
    told = repr(score(ahead, np.full((T, 2), 3.0), straight))
    assert "tracking error   rms 5 um, peak 5 um" in told and "rms 4.243" in told
    assert "duration         0.012 s" in told and "diverged         no" in told
    lost = repr(score(1e3 + ahead, NO_CONTROL, straight))
    assert "diverged         yes: its numbers mean nothing" in lost
    both = repr(score(np.stack([ahead, 1e3 + ahead], 1), np.zeros((T, 2, 2)), straight))
    assert "diverged         1 of 2 runs" in both
