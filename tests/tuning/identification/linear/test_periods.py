"""Periodic parts of a record show the response, resonance included, and a model follows from it."""

import numpy as np
import pytest

from jcontour.linear.continuous_axes import sampled_axis, speed_axis, with_resonance
from tuning.identification.linear.line_fit import fitted_to
from tuning.identification.linear.output_error import AxisRecord
from tuning.identification.linear.periods import periodic_lines, response_of_lines
from tuning.identification.linear.recording import RecordedAxis, recorded

DT, PERIOD, PERIODS, SECTIONS = 1e-3, 1000, 4, 3
HERTZ, DAMPING, DELAY = 55.0, 0.03, 1.4e-3
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
    assert np.all(told.half_width[above] >= 5.0)  # a resonance that answers ten times may hide
    assert np.all(np.diff(told.half_width[above]) > 0)


def test_moves_have_no_periods(record):
    part = record.part(SECTIONS * PERIODS * PERIOD, len(record.command))
    assert not periodic_lines(part).frequency.size
