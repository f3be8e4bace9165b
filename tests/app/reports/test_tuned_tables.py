"""Words of the tables of a tuning run."""

import pytest

from jcontour.app.files.results.tuned_result import Standstill
from jcontour.app.reports.tuned_tables import limit_words, trial_lines
from tests.app import small_runs


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


def test_the_control_at_standstill_is_shown_before_and_after():
    held = [Standstill(rms_control=one, rms_increment=0.1) for one in (1.0, 2.75)]
    standstill = dict(zip(("start", "tuned"), held, strict=True))
    (line,) = trial_lines(small_runs.tuned_result(standstill=standstill))
    assert "control 1 -> 2.75 A RMS" in line and "0.1 -> 0.1 per sample" in line
    assert [*trial_lines(small_runs.tuned_result(standstill={}))] == []
