"""Where a contour begins and which way it goes."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from jcontour.app.reports.figures.loops.way import draw_way

STEPS = 60  # of the runs


def drawn(runs):
    """Axes with the way of these runs."""
    axes = Figure().subplots()
    draw_way(axes, runs)
    return axes


def test_moves_between_cuts_are_rapid(runs):
    scored = runs.scored & ~np.isin(np.arange(STEPS), [30, 31, 32])
    cut = replace(runs, scored=scored)
    panel = drawn(cut)
    (rapid,) = [line for line in panel.get_lines() if line.get_label() == "rapid"]
    shown = ~np.isnan(rapid.get_xdata())
    assert np.flatnonzero(shown).tolist() == [*range(11), 29, 30, 31, 32, 33]  # up to the cuts


def test_arrows_show_which_way_the_contour_goes(runs):
    for arrow in drawn(runs).texts:
        tail, tip = np.array(arrow.xyann), np.array(arrow.xy)
        assert tail[0] * tip[1] > tail[1] * tip[0]  # round the origin, to the left


@pytest.mark.parametrize("gap", [(20, 50), (15, 27), (22, 23), (40, 58)])
def test_no_arrow_lies_across_a_rapid_move(runs, gap):
    """Each is as long as a step of a cut, 1.065 mm."""
    scored = runs.scored & ~np.isin(np.arange(STEPS), np.arange(*gap))
    for arrow in drawn(replace(runs, scored=scored)).texts:
        length = np.linalg.norm(np.array(arrow.xyann) - np.array(arrow.xy))
        assert 0.9 < length < 1.1


def test_arrows_of_many_laps_are_short(runs):
    """They are straight: half a lap long they would cross the part."""
    angle = np.linspace(0.0, 200 * np.pi, 40_000)
    place = 5e-3 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    laps = replace(runs, reference=place, scored=np.ones(len(place), bool))
    arrows = drawn(laps).texts
    assert len(arrows) == 3
    for arrow in arrows:
        length = np.linalg.norm(np.array(arrow.xyann) - np.array(arrow.xy))
        assert 0.4 < length < 0.6  # [mm], of a contour of 10 mm
