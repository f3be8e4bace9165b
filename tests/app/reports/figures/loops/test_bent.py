"""Figure of a bent reference: what its one legend names."""

import numpy as np
from matplotlib.colors import same_color

from jcontour.app.reports.figures.loops.bent import BentRuns, bent_figure


def test_no_two_curves_of_the_legend_have_one_colour():
    """Shifts of three axes above, errors with and without below."""
    random = np.random.default_rng(0)
    runs = BentRuns(
        name="part",
        error="contour",
        axes="XYZ",
        time=np.linspace(0.0, 1.0, 20),
        scored=np.ones(20, bool),
        correction=1e-6 * random.standard_normal((20, 3)),
        before=1e-5 * random.random((3, 20)),
        after=1e-6 * random.random((3, 20)),
    )
    (legend,) = bent_figure(runs).legends
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
