"""Figure of a jerk-limited motion: feed, and acceleration and jerk of the axes, over the path."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from experiments.reports.figures.shared.axes import DESIRED, OTHER, colours_of, grid, legend_below
from experiments.reports.figures.shared.curve import WORDS, draw_curve, long
from jcontour.motion.cornering import Planned
from jcontour.motion.jerk_limited.joints import unpadded

MM_PER_MIN = 60e3  # of a metre per second
POINTS = 4000  # evenly in time, beside the ends of smooth parts
MARGIN = 0.05  # of the feed


def motion_figure(planned: Planned, axes: Sequence[str]) -> Figure:
    """Feed, acceleration and jerk over the path, with rests that last as marks.

    Dashed are the limits of the axes, and the feed that is asked for where the picture reaches it.
    Of a long motion the sizes of acceleration and jerk are drawn: their means would be zero.
    """
    motion, rests = planned.motion, planned.rests
    time = np.union1d(motion.nodes, np.linspace(0.0, motion.duration, POINTS))
    along = 1e3 * motion.at(time).arc
    speed, acceleration, jerk = motion.axes_at(time)
    many = long(time.size)
    fed, asked = MM_PER_MIN * np.linalg.norm(speed, axis=1), MM_PER_MIN * motion.feed
    figure = Figure(figsize=(9, 7), layout="constrained")
    rows = figure.subplots(3, 1, sharex=True)
    ends = 1e3 * np.append(0.0, np.cumsum(unpadded(motion.path).extent))
    rows[0].stairs(asked, ends, baseline=None, color=OTHER, ls="--", label="feed asked for")
    draw_curve(rows[0], along, fed, DESIRED, 1.0, "feed")
    rows[0].set_ylim(-MARGIN * fed.max(), (1 + MARGIN) * max(fed.max(), asked.min()))
    held = 1e3 * motion.at(rests.begin[rests.lasting > 0]).arc
    if held.size:
        rows[0].plot(held, 0.0 * held, "v", color="black", label="rest", clip_on=False)
    size, signs = ("|", [1]) if many else ("", [-1, 1])
    grid(rows[0], WORDS if many else "", y="feed [mm/min]")
    grid(rows[1], y=f"{size}acceleration{size} [m/s$^2$]")
    grid(rows[2], x="way along the path [mm]", y=f"{size}jerk{size} [m/s$^3$]")
    colours = colours_of(axes)
    limits = motion.limits.acceleration, motion.limits.jerk
    for row, values, limit in zip(rows[1:], (acceleration, jerk), limits, strict=True):
        shown = np.abs(values) if many else values
        for k, name in enumerate(axes):
            draw_curve(row, along, shown[:, k], colours[name], 1.0, name)
            for sign in signs:
                row.axhline(sign * limit[k], color=colours[name], ls="--", lw=0.8)
    legend_below(figure, columns=5)
    return figure
