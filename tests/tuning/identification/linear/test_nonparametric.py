"""Periodic parts of a record show the response, resonance included, and a model follows from it."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from jcontour.linear.continuous_axes import sampled_axis, speed_axis, with_resonance
from tests.tuning.identification.linear.recorded_axes import RecordedAxis, recorded
from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.nonparametric import (
    agreed_to,
    averaged,
    clear_of,
    measured,
    periodic_lines,
    related,
    response_of_lines,
)
from tuning.identification.linear.output_error import AxisRecord, simulated
from tuning.identification.linear.rigid_axis import Simple
from tuning.identification.linear.validation import Estimate, Response
from tuning.identification.linear.vector_fitting import fitted_to

DT, PERIOD, PERIODS, SECTIONS = 1e-3, 1000, 4, 3
HERTZ, DAMPING, DELAY = 55.0, 0.03, 1.4e-3
HALF = 0.3  # 95 % interval of a line
LINES = np.arange(1, 121)


def multisine(random):
    time = DT * np.arange(PERIOD)
    waves = np.sin(2 * np.pi * np.outer(time, LINES) + random.uniform(0, 2 * np.pi, LINES.size))
    return np.tile(waves @ (2e-4 / LINES), PERIODS)


@pytest.fixture(scope="module")
def record():
    """Sections of different phases on a slow move, then one move that does not repeat."""
    random = np.random.default_rng(1)
    waves = np.concatenate([multisine(random) for _ in range(SECTIONS)])
    moves = 0.01 * np.sin(2 * np.pi * np.linspace(0, 1, 2 * PERIOD) ** 2)
    slow = 0.01 * DT * np.arange(len(waves))
    asked = np.concatenate([waves + slow, slow[-1] + moves])
    u, y = recorded(AXIS, asked, DT, random)
    return AxisRecord(DT, u, y)


AXIS = RecordedAxis(
    with_resonance(speed_axis(1.0, 5e-3, DELAY), 2 * np.pi * HERTZ, DAMPING),
    "speed",
    1e-7,
    1e-7,
    1e-3,
    (20.0,),
)


def true_response(hertz):
    A, B, C, late = sampled_axis(AXIS.axis, DT)
    z = np.exp(2j * np.pi * hertz * DT)
    return np.array([(C @ np.linalg.solve(one * np.eye(len(A)) - A, B)).item() for one in z]) / (
        z**late
    )


def test_intervals_hold_and_reach_to_the_last_line_that_is_excited(record):
    lines = periodic_lines(record)
    assert lines.frequency[0] == 1.0 and 100.0 < lines.frequency[-1] <= LINES[-1]
    off = np.abs(lines.value / true_response(lines.frequency) - 1)
    assert np.mean(off <= lines.half_width) > 0.9
    assert np.median(lines.half_width) < 0.1


def test_a_model_has_the_resonance_and_the_delay_of_a_part_of_a_sample(record):
    lines = periodic_lines(record)
    model = fitted_to(lines, DT, 4, 4)
    assert model.integrators == 1
    rates = np.log(model.poles[np.imag(model.poles) > 0]) / DT
    assert np.abs(rates).min() / (2 * np.pi) == pytest.approx(HERTZ, rel=5e-3)
    shown = np.linspace(1.0, 80.0, 80)
    off = np.abs(model.response(2 * np.pi * shown) / true_response(shown) - 1)
    assert off.max() < 0.05
    told = response_of_lines(lines, model)
    off = np.abs(told.value / true_response(told.frequency) - 1)
    assert np.mean(off <= told.half_width) > 0.95
    above = told.frequency > lines.frequency[-1]
    # a resonance that answers ten times may hide, of the model or of a mass like the last line
    over, size = told.frequency[above] / lines.frequency[-1], np.abs(told.value[above])
    most = np.maximum(size, np.abs(lines.value[-1]) / over**2)
    np.testing.assert_allclose(told.half_width[above] * size, 5.0 * over * most)


@pytest.mark.parametrize(("radius", "kept"), [(1.0003, 1 / 1.0003), (1.03, 1.03)])
def test_zeros_lie_inside_the_unit_circle_unless_the_lines_show_that_they_do_not(radius, kept):
    """Of an antiresonance at 40 Hz they hardly show the sign of its damping."""
    turn = 2 * np.pi * 40.0 * DT
    above = np.convolve([1.0], [1.0, -2 * radius * np.cos(turn), radius**2]) * 1e-3
    below = [-2 * 0.99 * np.cos(1.4 * turn), 0.99**2]
    axis = AxisModel(np.array(below), above, 1, 2, DT)
    hertz = np.arange(1.0, 120.0, 1.2)
    lines = Response(hertz, axis.response(2 * np.pi * hertz), np.full(hertz.size, HALF))
    zeros = np.roots(fitted_to(lines, DT, 3, 4, (1,)).numerator)
    pair = zeros[np.argmin(np.abs(np.angle(zeros) - turn))]
    assert np.abs(pair) == pytest.approx(kept, abs=1e-4)
    assert np.angle(pair) == pytest.approx(turn, rel=2e-3)


def test_a_model_moves_no_more_than_a_mass_above_the_lines():
    """A drive sampled at 4 kHz, its lines up to 150 Hz: a step of its command is no jump."""
    w, z, dt = 2 * np.pi * 60.0, 0.15, 0.25e-3
    a, b, *_ = cont2discrete(([90.0 * w**2], np.poly([-90.0, *w * np.roots([1, 2 * z, 1])])), dt)
    axis = AxisModel(b[1:], a.ravel()[1:], 0, 6, dt)
    hertz = np.geomspace(1.0, 150.0, 100)
    true = axis.response(2 * np.pi * hertz)
    random = np.random.default_rng(3)
    width = 0.01 + 1e-4 * (hertz / 10) ** 2
    errors = (random.normal(size=100) + 1j * random.normal(size=100)) * width / 4
    model = fitted_to(Response(hertz, true * (1 + errors), width), dt, 5, 10, (0,))
    above = 2 * np.pi * np.geomspace(300.0, 1900.0, 20)
    mass = np.abs(true[-1]) * (2 * np.pi * 150.0 / above) ** 2
    assert np.all(np.abs(model.response(above)) < 4 * mass)


def test_noise_of_a_command_that_is_sampled_fast_hides_no_period(record):
    """Of a cascade on counts: over a shorter sample it differs by its noise alone."""
    coarse = np.arange(len(record.command))
    fine = np.arange(4 * len(record.command) - 3) / 4
    command, position = (np.interp(fine, coarse, one) for one in (record.command, record.position))
    command += np.std(np.diff(record.command)) * np.random.default_rng(2).normal(size=len(fine))
    lines = periodic_lines(AxisRecord(DT / 4, command, position))
    assert len(lines.frequency) > 50
    np.testing.assert_allclose(lines.frequency, np.round(lines.frequency), rtol=1e-3)


def test_averaged_lines_hold_the_truth_and_keep_a_mode_that_the_model_lacks():
    random, hertz = np.random.default_rng(3), np.arange(2.0, 110.0)
    errors = random.standard_normal((2, hertz.size)) * HALF / 2 / np.sqrt(2)
    truth = true_response(hertz)
    lines = Response(hertz, truth * (1 + errors[0] + 1j * errors[1]), np.full(hertz.size, HALF))
    rigid = fitted_to(Response(hertz, truth, np.full(hertz.size, 0.5)), DT, 1, 4, (1,))
    found = averaged(lines, rigid)
    off = np.abs(truth / found.value - 1)
    assert np.mean(off <= found.half_width) > 0.9
    far = np.abs(hertz - HERTZ) > 20
    assert np.median(found.half_width[far]) < 0.6 * HALF
    at = np.abs(hertz - HERTZ) < 2
    assert np.array_equal(found.value[at], lines.value[at])


def test_lines_that_say_little_by_themselves_say_more_together():
    """Five of an interval of 1.2 have one of 1.2 / sqrt(5); one by itself is dropped."""
    axis = AxisModel(np.array([-0.9]), np.array([1e-3]), 1, 0, DT)
    hertz = np.array([20.0, 40.0, 40.5, 41.0, 41.5, 42.0, 60.0])
    lines = Response(hertz, axis.response(2 * np.pi * hertz), np.full(hertz.size, 1.2))
    found = clear_of(averaged(lines, axis))
    np.testing.assert_array_equal(found.frequency, hertz[1:-1])
    np.testing.assert_allclose(found.half_width, 1.2 / np.sqrt(5))
    np.testing.assert_allclose(found.value, lines.value[1:-1])


def test_lines_are_those_of_the_level_that_shows_them_best():
    """Small motion shows a response that large motion hides, and is hidden where noise is more."""
    random, axis = np.random.default_rng(4), AxisModel(np.array([-0.9]), np.array([0.1]), 0, 2, DT)
    command = np.concatenate([level * multisine(random) for level in np.repeat([1.0, 0.1], 2)])
    linear = simulated(AxisRecord(DT, command, command), axis).output
    room = 0.2 * np.abs(linear).max()  # beyond it the load moves by itself
    answer = linear + 3 * (linear - np.clip(linear, -room, room))
    noise = 1e-7 * random.standard_normal(len(answer))
    for position, bound in ((answer + noise, 0.05), (linear + noise, 0.005)):
        lines = periodic_lines(AxisRecord(DT, command, position))
        off = np.abs(lines.value / axis.response(2 * np.pi * lines.frequency) - 1)
        assert len(lines.frequency) > 50 and np.median(off) < bound
        assert np.mean(off <= lines.half_width) > 0.85


def test_many_short_periods_may_end_with_the_record():
    random = np.random.default_rng(5)
    once = np.convolve(random.standard_normal(256), np.ones(20) / 20, "same")
    command, noise = 1e-3 * np.tile(once, 60), 1e-7 * random.standard_normal(15360)
    answer = simulated(AxisRecord(DT, command, command), TRUTH).output
    periods = periodic_lines(AxisRecord(DT, command, answer + noise)).frequency * 0.256
    assert periods.size > 5 and np.allclose(periods, np.round(periods))


def test_moves_have_no_periods(record):
    part = record.part(SECTIONS * PERIODS * PERIOD, len(record.command))
    assert not periodic_lines(part).frequency.size


ROWS = 20_000
TRUTH = AxisModel(np.array([-1.7, 0.9]), np.array([0.02, 0.01]), 0, 2, DT)

WRONG = AxisModel(np.array([-1.6, 0.8]), np.array([0.03, 0.01]), 0, 2, DT)  # of another mode


@pytest.fixture(scope="module")
def lines():
    """Of an excited axis with friction and a little noise, beside a model of another mode."""
    random = np.random.default_rng(2)
    command, signs = random.standard_normal((2, ROWS))
    record = AxisRecord(DT, command, np.zeros(ROWS), (np.sign(signs),))
    late = np.concatenate([np.zeros(2), command[:-2]]) + 0.4 * np.sign(signs)
    answer = np.convolve(late, impulse())[:ROWS] + 0.002 * random.standard_normal(ROWS)
    record = AxisRecord(DT, command, answer, (np.sign(signs),))
    return measured(beside(record, WRONG, np.array([0.4])))


def beside(record, model, drag):
    """A simple model of a record."""
    estimate = Estimate((), np.zeros(0), np.zeros((0, 0)))
    return Simple(record, simulated(record, model, drag=drag), np.zeros(0), 1.0, estimate)


def impulse():
    """Of the axis without its delay."""
    h = np.zeros(400)
    for k in range(1, 400):
        h[k] = 1.7 * h[k - 1] - 0.9 * h[k - 2] + (0.02 if k == 1 else 0.01 if k == 2 else 0.0)
    return h


def test_the_intervals_hold_the_true_response(lines):
    truth = TRUTH.response(2 * np.pi * lines.frequency)
    inside = np.abs(truth / lines.value - 1) < lines.half_width + 0.02  # a window blurs the mode
    assert lines.frequency[-1] > 250 and inside.mean() > 0.9


def test_nothing_is_kept_where_nothing_moves():
    record = AxisRecord(DT, np.sin(np.arange(ROWS) * 0.05), np.zeros(ROWS))
    noise = 1e-3 * np.random.default_rng(0).standard_normal(ROWS)
    record = AxisRecord(DT, record.command, record.command + noise)
    found = measured(beside(record, AxisModel(np.zeros(0), np.ones(1), 0, 0, DT), None))
    assert np.all(found.frequency < 15)  # the sine has 8 Hz


def test_columns_that_have_nothing_in_common():
    one, other = np.random.default_rng(3).standard_normal((2, ROWS))
    assert not related(AxisRecord(DT, one, np.cumsum(other)))
    assert related(AxisRecord(DT, one, np.cumsum(one + 3 * other)))


def test_a_mass_is_known_below_the_mode_that_it_lacks():
    """Two masses by a motor's encoder over one: (1 - (f / f_a)^2) / (1 - (f / f_r)^2)."""
    hertz = np.arange(4.5, 200.0)
    model = AxisModel(np.array([-0.9]), np.array([1e-3]), 1, 0, DT)
    ratio = (1 - (hertz / 44.9) ** 2) / (1 - (hertz / 55.0) ** 2)
    value = model.response(2 * np.pi * hertz) * ratio
    lines = Response(hertz, value, np.full(len(hertz), 0.01))
    first = hertz[np.abs(1 / ratio - 1) > 0.11][0]
    assert agreed_to(lines, model) == first and 15 < first < 30
    assert agreed_to(Response(hertz, value / ratio, lines.half_width), model) == np.inf
