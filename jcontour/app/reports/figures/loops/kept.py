"""Figure of the runs of a bounded MPC: every error over time, and the tolerance above them."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from jcontour.app.files.results.tolerance_result import ToleranceResult
from jcontour.app.reports.figures.shared.axes import grid, legend_below
from jcontour.motion.references import Reference


def kept_figure(
    result: ToleranceResult, reference: Reference, errors: Sequence[np.ndarray]
) -> Figure:
    """Runs within the bounds thick, those of other plants thin; the tolerance dashed."""
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    axes = figure.subplots()
    scored = np.asarray(reference.mask)[: reference.steps]
    time = reference.dt * np.arange(reference.steps)
    for number, (run, error) in enumerate(zip(result.runs, errors, strict=True)):
        shown = np.where(scored, 1e6 * error, np.nan)
        label = f"{run.plant}, {run.disturbance}"
        axes.plot(
            time, shown, color=f"C{number}", linewidth=1.0 if run.within else 0.5, label=label
        )
    promised = 1e6 * result.promised
    axes.axhline(promised, color="0.2", linestyle="--", linewidth=1.0, label="promised")
    axes.set_ylim(bottom=0.0)
    title = f"{result.contour} on {result.machine.name}: promised {promised:.4g} um"
    grid(axes, title, "time [s]", f"{result.error} error [um]")
    legend_below(figure)
    return figure
