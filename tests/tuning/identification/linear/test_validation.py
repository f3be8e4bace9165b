from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from jcontour.linear.continuous_axes import force_axis, position_axis
from tests.tuning.identification.linear.recorded_axes import RecordedAxis, recorded
from tuning.identification.linear import validation
from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.output_error import (
    WHITE,
    AxisFit,
    AxisRecord,
    simulated,
    with_slopes,
)
from tuning.identification.linear.validation import encoder_noise

DT, ROWS, K, T = 1e-3, 4000, 0.03, 0.012
P = np.exp(-DT / T)
ONE = np.ones(1)
TRUTH = AxisModel(
    np.array([-P]),
    K * T * np.array([DT / T - 1 + P, 1 - P - DT / T * P]),
    1,
    1,
    DT,
)


@pytest.mark.parametrize(("highest", "shown"), [(60.0, 60.0), (500.0, 400.0)])
def test_a_response_is_shown_as_far_as_the_record_was_excited(highest, shown):
    """A multisine up to a frequency, behind noise that is far smaller below it."""
    random, seconds = np.random.default_rng(0), 20.0
    time = DT * np.arange(int(seconds / DT))
    lines = np.arange(0.5, highest, 0.5)
    answer = sum(np.sin(2 * np.pi * f * time + p) for f, p in zip(lines, lines**2, strict=True))
    noise = 1e-3 * random.standard_normal(time.size)
    frequency = np.geomspace(0.2, 0.8 * 0.5 / DT, 120)
    known = validation.Response(frequency, np.ones(120, complex), np.full(120, 0.01))
    found = validation.excited_to(known, answer + noise, noise)
    assert found == pytest.approx(shown, rel=0.12)
    held = validation.as_excited(known, found)
    above = frequency > found
    assert np.all(held.half_width[above] == validation.HIDDEN / 2) and held.band[1] == found
    assert np.all(held.half_width[~above] == 0.01)


def test_the_band_ends_where_intervals_widen():
    frequency = np.array([1.0, 2.0, 4.0, 8.0, 16.0])
    one = validation.Response(
        frequency, np.ones(5, complex), np.array([0.5, 0.02, 0.01, 0.05, 0.4])
    )
    assert one.band == (2.0, 8.0)
    none = validation.Response(frequency, np.ones(5, complex), np.full(5, 0.5))
    assert np.isnan(none.band).all()


def test_a_response_at_given_frequencies():
    """Of two records of other lengths, which by themselves begin at other ones."""
    u = np.random.default_rng(2).standard_normal(ROWS)
    y = np.asarray(lfilter([0.0, 0.1], [1.0, -0.9], u))
    at, found = np.array([3.0, 30.0]), []
    model = AxisModel(-0.9 * ONE, 0.1 * ONE, 0, 0, DT)
    for rows in (ROWS, ROWS // 2):
        fit = with_slopes(AxisRecord(DT, u[:rows], y[:rows]), model)
        one = validation.response_of(fit, validation.estimate_of(fit), at)
        assert np.array_equal(one.frequency, at)
        found.append(one.value)
        own = validation.response_of(fit, validation.estimate_of(fit))
        assert own.frequency[0] == pytest.approx(3 / (rows * DT))
    back = np.exp(-2j * np.pi * at * DT)
    for value in found:
        assert value == pytest.approx(0.1 * back / (1 - 0.9 * back), rel=1e-6)


def test_a_command_at_its_limit_is_counted():
    u = np.sin(np.arange(1000) * 0.02)
    assert validation.saturated(u) == 0
    limited = np.clip(u, -0.9, 0.9)
    assert validation.saturated(limited) == pytest.approx(np.mean(np.abs(limited) == 0.9), abs=0.01)


def test_signs_and_counts():
    y = 1e-6 * np.round(np.concatenate([np.zeros(50), np.arange(100), np.full(50, 100)]))
    assert validation.resolution_of(y) == pytest.approx(1e-6)
    signs = validation.speed_signs(y, 1e-6)
    assert set(np.unique(signs)) == {-1.0, 0.0}
    assert (signs[60:140] == -1).all() and not signs[:40].any()
    assert validation.resolution_of(np.zeros(5)) == 0.0
    smooth = np.random.default_rng(0).standard_normal(4000)
    assert validation.noise_of(smooth) == pytest.approx(1.0, rel=0.1)
    assert validation.resolution_of(smooth) == pytest.approx(0.35, rel=0.1)


def test_the_count_is_told_whatever_noise_and_motion_are():
    """Noise of six counts, a swing of 100 samples, and digits that are cut off."""
    random, time = np.random.default_rng(0), np.arange(4000)
    place = 2e-3 * np.sin(2 * np.pi * time / 100) + 6e-6 * random.standard_normal(time.size)
    assert validation.resolution_of(1e-6 * np.round(place / 1e-6)) == pytest.approx(1e-6)
    screw = 1.25e-6 * np.round(place / 1.25e-6)
    assert validation.resolution_of(np.round(screw, 8)) == pytest.approx(1.25e-6, rel=0.01)
    printed = validation.resolution_of(np.round(place, 9))  # digits of a nanometre are no counts
    assert printed > 0.3 * 6e-6


def test_another_axis_in_the_errors():
    random = np.random.default_rng(5)
    u, other = (np.repeat(random.standard_normal(ROWS // 8), 8) for _ in range(2))
    y = lfilter(TRUTH.above, TRUTH.below, u + 0.05 * other) + 1e-6 * random.standard_normal(ROWS)
    fit = with_slopes(AxisRecord(DT, u, y), TRUTH, filter_=WHITE)
    part, number = validation.coupling(fit, other)
    assert part > 0.5 and number > 100
    chance, small = validation.coupling(fit, random.standard_normal(ROWS))
    assert chance < 0.01 and small < 20


def with_errors(errors, jacobian):
    """A fit of nothing but errors and slopes."""
    none = np.zeros(0)
    model = AxisModel(np.zeros(1), np.ones(1), 0, 0, 1e-3)
    rows = np.arange(len(errors))
    return AxisFit(model, none, none, none, none, none, errors, jacobian, rows)


def test_errors_of_noise_pull_no_more_than_noise():
    """Fifty fits; the threshold lets one in thousands through."""
    random = np.random.default_rng(0)
    slopes = random.standard_normal((20_000, 3)).cumsum(axis=0)
    for _ in range(50):
        errors = random.standard_normal(20_000)
        errors -= slopes @ np.linalg.lstsq(slopes, errors, rcond=None)[0]
        assert validation.dispersion(with_errors(errors, slopes)) == 1.0


def test_errors_that_pull_on_are_counted():
    """Slopes of one, errors of noise and +-1 by block: 500^2 in a block, of 500 (1 + 0.25) s^2."""
    random = np.random.default_rng(1)
    push = np.repeat(np.tile([1.0, -1.0], 20), validation.BLOCK)
    errors = push + 0.5 * random.standard_normal(len(push))
    found = validation.dispersion(with_errors(errors, np.ones((len(push), 1))))
    assert found == pytest.approx(validation.BLOCK / 1.25, rel=0.05)


LONG, COUNT = 30_000, 1e-6
FORCE = force_axis(40.0, 80.0, 300.0)


def record(axis, takes, loop, noise, disturbance):
    """Slow arcs under a cascade; counts of 1 um."""
    random = np.random.default_rng(4)
    reference = 0.01 * np.sin(2 * np.pi * 0.7 * DT * np.arange(LONG))
    one = RecordedAxis(axis, takes, COUNT, noise, disturbance, loop)
    return AxisRecord(DT, *recorded(one, reference, DT, random))


def force_model():
    """K / (M s^2 + F s) under a held command, in closed form."""
    T, K = 80 / 300, 40 / 300
    p = np.exp(-DT / T)
    b = K * T * np.array([DT / T - 1 + p, 1 - p - DT / T * p])
    return AxisModel(np.array([-p]), b, 1, 0, DT)


@pytest.mark.parametrize("disturbance", [0.0, 2e-3])
@pytest.mark.parametrize("noise", [0.5e-6, 3e-6])
def test_noise_is_told_from_what_comes_to_the_command(noise, disturbance):
    one = record(FORCE, "force", (10.0, 100.0), noise, disturbance)
    found = encoder_noise(simulated(one, force_model()), COUNT)
    assert found == pytest.approx(noise, rel=0.04)


@pytest.mark.parametrize("disturbance", [0.0, 2e-3])
def test_rounding_alone_is_no_noise(disturbance):
    one = record(FORCE, "force", (10.0, 100.0), 0.0, disturbance)
    assert encoder_noise(simulated(one, force_model()), COUNT) == 0.0


def test_noise_behind_a_larger_one_of_the_command_is_not_told():
    """A quick position drive: at half the sampling rate the command brings 14 um."""
    axis = position_axis(1.0, 0.001)
    p = np.exp(-1.0)
    model = AxisModel(np.array([-p]), np.array([1 - p]), 0, 0, DT)
    one = record(axis, "position", (1.0,), 0.5e-6, 2e-3)
    assert encoder_noise(simulated(one, model), COUNT) == 0.0


def test_a_record_without_any_error_has_no_noise():
    one = record(FORCE, "force", (10.0, 100.0), 0.0, 0.0)
    exact = simulated(one, force_model())
    assert encoder_noise(replace(exact, residual=0 * exact.residual), COUNT) == 0.0
