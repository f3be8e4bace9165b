"""Figure of a jerk-limited motion: feed, and acceleration and jerk of the axes, over the path."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure

from experiments.reports.figures.shared.axes import DESIRED, OTHER, colours_of, grid, legend_below
from experiments.reports.thinning import kept_samples
from jcontour.motion.cornering import Planned
from jcontour.motion.jerk_limited.joints import unpadded

MM_PER_MIN = 60e3  # of a metre per second
POINTS = 4000  # evenly in time, beside the ends of smooth parts
MARGIN = 0.05  # of the feed
MOST = 20_000  # points that are drawn: twenty for every dot across


def motion_figure(planned: Planned, axes: Sequence[str]) -> Figure:
    """Feed, acceleration and jerk over the path, with rests that last as marks.

    Dashed are the limits of the axes, and the feed that is asked for where the picture reaches it.
    """
    motion, rests = planned.motion, planned.rests
    time = np.union1d(motion.nodes, np.linspace(0.0, motion.duration, POINTS))
    along = 1e3 * motion.at(time).arc
    speed, acceleration, jerk = motion.axes_at(time)
    fed, asked = MM_PER_MIN * np.linalg.norm(speed, axis=1), MM_PER_MIN * motion.feed
    kept = _kept(fed, acceleration, jerk)
    along, fed, acceleration, jerk = (rows[kept] for rows in (along, fed, acceleration, jerk))
    figure = Figure(figsize=(9, 7), layout="constrained")
    rows = figure.subplots(3, 1, sharex=True)
    ends = 1e3 * np.append(0.0, np.cumsum(unpadded(motion.path).extent))
    rows[0].stairs(asked, ends, baseline=None, color=OTHER, ls="--", label="feed asked for")
    rows[0].plot(along, fed, color=DESIRED, lw=1, label="feed")
    rows[0].set_ylim(-MARGIN * fed.max(), (1 + MARGIN) * max(fed.max(), asked.min()))
    held = 1e3 * motion.at(rests.begin[rests.lasting > 0]).arc
    if held.size:
        rows[0].plot(held, 0.0 * held, "v", color="black", label="rest", clip_on=False)
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
    legend_below(figure, columns=5)
    return figure


def _kept(
    fed: Float[np.ndarray, " T"],
    acceleration: Float[np.ndarray, "T m"],
    jerk: Float[np.ndarray, "T m"],
) -> Int[np.ndarray, " K"]:
    """Points that are drawn: of a long motion those of its peaks, either way."""
    both = np.concatenate([acceleration, jerk], axis=1).T
    peaks = [fed[None], fed.max() - fed[None], both.clip(min=0.0), (-both).clip(min=0.0)]
    return kept_samples(np.concatenate(peaks), MOST)
