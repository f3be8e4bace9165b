"""Figure of a bent reference: the correction over time, and the errors with and without it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from jcontour.app.reports.figures.shared.axes import CYCLE, START, TUNED, grid, legend_below

SHIFTS = tuple(colour for colour in CYCLE if colour not in (START, TUNED))  # of axes


@dataclass(frozen=True)
class BentRuns:
    """A correction, and errors with and without it.

    Attributes:
        name: of contour, machine and controller, in words.
        error: the error that counts, "contour" or "tracking".
        axes: names of the m axes.
        time: (T,) [s].
        scored: (T,) which samples count.
        correction: (T, m) [m].
        before, after: size of the error of every plant, the nominal one first (P, T) [m].
    """

    name: str
    error: str
    axes: Sequence[str]
    time: np.ndarray
    scored: np.ndarray
    correction: np.ndarray
    before: np.ndarray
    after: np.ndarray


def bent_figure(runs: BentRuns) -> Figure:
    """Errors of the nominal plant thick, of the family thin."""
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for axis, shift, colour in zip(runs.axes, runs.correction.T, SHIFTS, strict=False):
        label = f"shift of {axis}"
        upper.plot(runs.time, 1e6 * shift, color=colour, linewidth=1.0, label=label)
    grid(upper, runs.name, "", "correction [um]")
    shown: Mapping[str, tuple[np.ndarray, str]] = {
        "reference as it is": (runs.before, START),
        "bent reference": (runs.after, TUNED),
    }
    for label, (errors, colour) in shown.items():
        sizes = np.where(runs.scored, 1e6 * errors, np.nan)
        lower.plot(runs.time, sizes[1:].T, color=colour, linewidth=0.4, alpha=0.5)
        lower.plot(runs.time, sizes[0], color=colour, linewidth=1.2, label=f"{label}, nominal")
    counted = np.stack([runs.before, runs.after])[..., runs.scored]
    if (counted > 0).any():  # an exactly followed part has no logarithm
        lower.set_yscale("log")
        lower.set_ylim(bottom=max(1e-3, 1e2 * float(np.nanmax(counted[0]))))
    grid(lower, "thin: the other plants of the family", "time [s]", f"{runs.error} error [um]")
    legend_below(figure)
    return figure
