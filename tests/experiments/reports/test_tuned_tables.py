"""Words of the tables of a tuning run."""

from types import SimpleNamespace

import pytest

from experiments.files.results.tuned_result import Standstill
from experiments.reports.tuned_tables import limit_words, standstill_lines


@pytest.mark.parametrize(
    ("name", "bound", "words"),
    [
        ("rms_tracking_error", 1.25e-4, "rms tracking error <= 125 um"),
        ("peak_sensitivity", 2.0, "peak sensitivity <= 2"),
        ("control_use", 0.97, "control within 97 % of the machine's"),
    ],
)
def test_limits_are_told_in_the_units_of_the_tables(name, bound, words):
    assert limit_words(name, bound) == words


@pytest.mark.parametrize(("control", "warned"), [(2.4, False), (2.75, True)])
def test_more_than_the_limit_of_the_noise_at_standstill_is_told(control, warned):
    held = [Standstill(rms_control=one, rms_increment=0.1) for one in (1.0, control)]
    result = SimpleNamespace(
        standstill=dict(zip(("start", "tuned"), held, strict=True)),
        machine=SimpleNamespace(control_unit="mm/s"),
        limits={"count_noise": 2.5},
    )
    first, *more = standstill_lines(result)
    assert "1 -> " in first and bool(more) == warned
    assert all("2.5 mm/s" in line and "WARNING" in line for line in more)
