"""What the figure of the searches shows."""

import numpy as np

from experiments.benchmarks.searches.tuners_figure import Curve, tuners_figure


def test_each_problem_has_a_panel_with_medians():
    counts = np.array([1, 10, 100])
    curve = Curve(counts, np.array([2.0, 1, 1]), np.array([np.inf, 2, 1]), np.array([np.inf, 3, 1]))
    figure = tuners_figure({"a": {"jcontour": curve, "Sobol": curve}, "b": {"jcontour": curve}})
    first, second = (axes for axes in figure.axes if axes.get_visible())
    assert [line.get_label() for line in first.lines] == ["jcontour", "Sobol"]
    np.testing.assert_array_equal(first.lines[0].get_xydata()[1:], [[10, 2], [100, 1]])
    assert second.get_title() == "b" and len(second.lines) == 1
