"""Figure of a jerk-limited motion: feed, and acceleration and jerk of the axes, over the path."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.reports.figures.shared.axes import DESIRED, colours_of, grid, legend_below
from experiments.reports.figures.shared.png import save_figure
from jcontour.motion.cornering import Planned

MM_PER_MIN = 60e3  # of a metre per second
POINTS = 4000  # along the path


def motion_figure(planned: Planned, axes: Sequence[str]) -> Figure:
    """Feed, acceleration and jerk over the path, with the limits dashed, and dwells as marks."""
    motion, rests = planned.motion, planned.rests
    time = np.linspace(0.0, motion.duration, POINTS)
    along = 1e3 * motion.at(time).arc
    speed, acceleration, jerk = motion.axes_at(time)
    figure = Figure(figsize=(9, 7), layout="constrained")
    rows = figure.subplots(3, 1, sharex=True)
    rows[0].plot(along, MM_PER_MIN * np.linalg.norm(speed, axis=1), color=DESIRED, lw=1)
    held = 1e3 * motion.at(rests.begin[rests.lasting > 0]).arc
    if held.size:
        rows[0].plot(held, 0.0 * held, "v", color="black", label="dwell", clip_on=False)
        rows[0].legend(loc="upper right")
    grid(rows[0], y="feed [mm/min]")
    grid(rows[1], y="acceleration [m/s$^2$]")
    grid(rows[2], x="way along the path [mm]", y="jerk [m/s$^3$]")
    colours = colours_of(axes)
    limits = motion.limits.acceleration, motion.limits.jerk
    for row, values, limit in zip(rows[1:], (acceleration, jerk), limits, strict=True):
        for k, name in enumerate(axes):
            row.plot(along, values[:, k], color=colours[name], lw=1, label=name)
            for sign in (-1, 1):
                row.axhline(sign * limit[k], color=colours[name], ls="--", lw=0.8)
    legend_below(figure, rows[2])
    return figure


def draw_motion(planned: Planned, axes: Sequence[str], folder: Path) -> Path:
    """Draw the motion into `motion.png` of a folder."""
    return save_figure(motion_figure(planned, axes), folder / "motion.png")
