"""Figures of Tomizuka, Hu, Chiu & Kamano, drawn from a result."""

from collections.abc import Sequence
from functools import partial

from matplotlib.figure import Figure

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.synchronisation.experiment import (
    CONTINUOUS,
    FAST,
    NOMINAL,
    SLOW,
    Result,
)
from jcontour.app.reports.figures.axes import CYCLE

SHOWN = 0.4  # [s] after the load


def responses(
    result: Result, period_ms: float, shown: Sequence[float], betas: Sequence[float], title: str
) -> Figure:
    """Both errors at two couplings, and the difference at many."""
    panels, x = [], "time after the load [s]"
    limits = {"xlim": (0.0, SHOWN)}
    for beta in shown:
        row = result.row(NOMINAL, period_ms, beta)
        time = row.time_s - row.time_s[0]
        curves = [
            Curve(time, row.e1, "e1, no load", {"color": CYCLE[0]}),
            Curve(time, row.e2, "e2, load", {"color": CYCLE[1]}),
        ]
        panels.append(Panel(f"errors, beta = {beta:g}", x, "speed [per unit]", curves, limits))
    apart = []
    for colour, beta in zip(CYCLE, betas, strict=False):
        row = result.row(NOMINAL, period_ms, beta)
        time, name = row.time_s - row.time_s[0], f"e1 - e2, beta = {beta:g}"
        apart.append(Curve(time, row.e1 - row.e2, name, {"color": colour}))
    panels.append(Panel("synchronisation error", x, "", apart, limits))
    whole = f"Step of load on axis 2, {title}; the axes are ours"
    return drawn(panels, (11.0, 4.2), whole, columns=3, legend=4, sharey=True)


MANY = (0.0, 1.0, 2.0, 5.0, 10.0)
FIGURES = {
    # two couplings, and the difference over beta; at 10 ms beta = 4 diverges
    "figures-3-to-6": partial(
        responses, period_ms=CONTINUOUS, shown=(0.0, 5.0), betas=MANY, title="continuous time"
    ),
    "figures-9-to-11": partial(
        responses, period_ms=FAST, shown=(0.0, 2.0), betas=MANY, title="2 ms"
    ),
    "figures-12-to-14": partial(
        responses, period_ms=SLOW, shown=(0.0, 3.0), betas=(0.0, 1.0, 2.0, 3.0, 3.5), title="10 ms"
    ),
}
