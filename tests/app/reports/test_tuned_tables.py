"""Words of the tables of a tuning run."""

import pytest

from jcontour.app.reports.tuned_tables import limit_words


@pytest.mark.parametrize(
    ("name", "bound", "words"),
    [
        ("rms_tracking_error", 1.25e-4, "rms tracking error <= 125 um"),
        ("peak_sensitivity", 2.0, "peak sensitivity <= 2"),
        ("control_use", 0.97, "control <= 97 % of the machine's limit"),
    ],
)
def test_limits_are_told_in_the_units_of_the_tables(name, bound, words):
    assert limit_words(name, bound) == words
