import numpy as np

from jcontour.app.reports.figures.tuning.sensitivity import sensitivity_figure
from jcontour.app.runs.tuning.family_loops import FamilyCurves

HERTZ = np.array([1.0, 10.0, 100.0])


def test_the_largest_of_every_design_and_the_bound_are_drawn():
    start = np.array([[0.1, 3.0, 1.0], [0.2, 2.0, 1.1], [np.nan, np.nan, np.nan]])
    tuned = np.array([[0.1, 1.5, 1.0], [0.05, 1.9, 1.0]])
    curves = {"start": FamilyCurves(HERTZ, start), "tuned": FamilyCurves(HERTZ, tuned)}
    drawn = sensitivity_figure(curves, 2.0).axes[0].get_lines()
    heights = {line.get_label(): np.asarray(line.get_ydata()).tolist() for line in drawn}
    assert heights["start, largest of the family"] == [0.2, 3.0, 1.1]
    assert heights["tuned, largest of the family"] == [0.1, 1.9, 1.0]
    assert heights["start: 1 of 3 plants not stable, not drawn"] == []
    assert heights["limit 2"] == [2.0, 2.0]


def test_no_stable_plant_and_no_bound():
    curves = {"start": FamilyCurves(HERTZ, np.full((2, 3), np.nan))}
    labels = [line.get_label() for line in sensitivity_figure(curves, None).axes[0].get_lines()]
    assert [name for name in labels if not name.startswith("_")] == [
        "start: 2 of 2 plants not stable, not drawn"
    ]
