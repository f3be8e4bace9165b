"""Figure of a certificate: bound, attacked error and undisturbed error along the path."""

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from jcontour.app.reports.figures.shared.axes import DESIRED, START, TUNED, grid, legend_below


@dataclass(frozen=True)
class CertifiedErrors:
    """Errors of one contour on one plant.

    Attributes:
        name: of contour and plant, in words.
        error: the error that counts, "contour" or "tracking".
        time: [s].
        bound: proven at every sample [m].
        reached: under the attack on the worst sample [m].
        nominal: without disturbance [m].
        scored: which samples count.
    """

    name: str
    error: str
    time: np.ndarray
    bound: np.ndarray
    reached: np.ndarray
    nominal: np.ndarray
    scored: np.ndarray


def certificate_figure(errors: CertifiedErrors) -> Figure:
    """Bound above, attacked error below it: they meet at the sample that is attacked."""
    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    axes = figure.subplots()
    for label, values, colour in (
        ("bound, proven", errors.bound, START),
        ("reached under attack", errors.reached, TUNED),
        ("undisturbed", errors.nominal, DESIRED),
    ):
        shown = np.where(errors.scored, 1e6 * values, np.nan)
        axes.plot(errors.time, shown, color=colour, label=label, linewidth=1.0)
    axes.set_ylim(bottom=0.0)
    grid(axes, errors.name, "time [s]", f"{errors.error} error [um]")
    legend_below(figure)
    return figure
