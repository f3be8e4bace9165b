"""Errors over time."""

from dataclasses import replace

import numpy as np

from jcontour.app.reports.figures.loops.errors import error_figure


def test_errors_over_time_are_in_micrometres(runs):
    figure = error_figure(runs)
    nominal = figure.axes[0].get_lines()
    np.testing.assert_allclose(nominal[0].get_ydata()[10:], 1.0)
    np.testing.assert_allclose(nominal[1].get_ydata()[10:], 0.1)
    worst = figure.axes[1].get_lines()
    np.testing.assert_allclose(worst[0].get_ydata()[10:], 40.0)
    assert worst[1].get_label() == "tuned, largest RMS (heavy), diverged"


def test_rapid_moves_are_left_out_and_told(runs):
    cut = replace(runs, scored=runs.scored & (np.abs(np.arange(runs.scored.size) - 31) > 1))
    drawn = error_figure(cut).axes[0].get_lines()[0].get_ydata()
    assert np.flatnonzero(np.isnan(drawn)).tolist() == [*range(10), 30, 31, 32]
    assert "rapid" in error_figure(cut).get_suptitle()
    assert "rapid" not in error_figure(runs).get_suptitle()
