"""Figures of one loop show what its runs did."""

import numpy as np
from matplotlib.colors import same_color

from jcontour.app.reports.figures.loops import (
    ErrorCurve,
    bent_figure,
    errors_figure,
)
from jcontour.motion.references import Reference
from tests.app.small_runs import partly


def reference_of(*scored, dt):
    """A reference with these samples that count, as far as a figure reads it."""
    return partly(Reference, dt=dt, steps=len(scored), mask=np.array(scored))


def test_no_two_curves_of_the_legend_have_one_colour():
    """Shifts of three axes above, errors with and without below."""
    random, reference = np.random.default_rng(0), reference_of(*[True] * 20, dt=0.05)
    shift, errors = 1e-6 * random.standard_normal((20, 3)), 1e-5 * random.random((2, 3, 20))
    figure = bent_figure("part", "contour", "XYZ", reference, shift, *errors)
    (legend,) = figure.legends
    entries = zip(legend.get_texts(), legend.get_lines(), strict=True)
    named = {text.get_text(): line for text, line in entries}
    assert list(named) == [
        "shift of X",
        "shift of Y",
        "shift of Z",
        "reference as it is, nominal",
        "bent reference, nominal",
    ]
    colours = [line.get_color() for line in named.values()]
    for k, colour in enumerate(colours):
        assert not any(same_color(colour, other) for other in colours[:k])


def test_errors_are_in_um_where_samples_count():
    reference = reference_of(False, True, True, dt=0.1)
    curves = [
        ErrorCurve("bound", np.array([3e-6, 4e-6, 5e-6]), "C0"),
        ErrorCurve("reached", np.array([1e-6, 2e-6, 4.9e-6]), "C1"),
    ]
    (axes,) = errors_figure("circle, late", "contour", reference, curves).axes
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in axes.lines}
    np.testing.assert_allclose(lines["bound"], [np.nan, 4.0, 5.0])
    np.testing.assert_allclose(lines["reached"], [np.nan, 2.0, 4.9])
    assert axes.get_ylabel() == "contour error [um]" and axes.get_ylim()[0] == 0.0
