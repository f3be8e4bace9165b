"""Figure of a jerk-limited motion: feed, and acceleration and jerk of the axes, over the path."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.markers import CARETUP

from jcontour.app.plain_numbers import MM_PER_MIN
from jcontour.app.reports.figures.axes import (
    COLUMNS,
    DESIRED,
    OTHER,
    WORDS,
    colours_of,
    draw_curve,
    grid,
    legend_below,
    long,
)
from jcontour.geometry.contour import unpadded
from jcontour.motion.cornering import Planned

POINTS = 4000  # evenly in time, beside the ends of smooth parts
IN_A_COLUMN = 4  # points of every column of the picture: a rapid move takes little time there
MARGIN = 0.05  # of the feed
MARKS = 0.22  # of the feed, below zero: the strip where stops are marked
STOP, WAIT = 0.12, 0.04  # of the height: where in it
TOP = 1.25  # of the feed of the cuts: rapid moves are cut off above it
ON_BORDER = 1e-9  # [m] a place so near to the border of two pieces is on both
RAPID, SHADE = "tab:purple", "0.93"


class _Curves(NamedTuple):
    """What is drawn over the way: rows T, and columns for the axes."""

    along: Float[np.ndarray, " T"]  # way along the path [mm]
    fed: Float[np.ndarray, " T"]  # speed of the tool [mm/min]
    acceleration: Float[np.ndarray, "T m"]  # of the axes [m/s^2]
    jerk: Float[np.ndarray, "T m"]  # of the axes [m/s^3]
    # which points are on a cut; where a rapid move begins or ends, they are on both
    cut: Bool[np.ndarray, " T"]
    rapid: Bool[np.ndarray, " T"]  # which are on a rapid move


def motion_figure(planned: Planned, axes: Sequence[str], rapid: Bool[np.ndarray, " P"]) -> Figure:
    """Feed, acceleration and jerk over the path, with marks where the tool stops and waits.

    Rapid moves have a feed of another colour before a grey ground; where they are faster than all
    cuts, the picture cuts them off and says how fast they are. Dashed are the limits of the axes,
    and the feed that is asked for. Of a long motion the sizes of acceleration and jerk are drawn:
    their means would be zero.

    Args:
        planned: the motion.
        axes: names.
        rapid: which pieces of the contour are rapid moves.
    """
    rapid = rapid[planned.around.piece]  # now of the path, which has blends
    curves = _curves(planned, rapid)
    many = long(curves.along.size)
    figure = Figure(figsize=(9, 7), layout="constrained")
    rows = figure.subplots(3, 1, sharex=True)
    _draw_feed(rows[0], planned, curves, rapid)
    size = "|" if many else ""
    grid(rows[0], WORDS if many else "", y="feed [mm/min]")
    grid(rows[1], y=f"{size}acceleration{size} [m/s$^2$]")
    grid(rows[2], x="way along the path [mm]", y=f"{size}jerk{size} [m/s$^3$]")
    colours = colours_of(axes)
    limits = planned.motion.limits.acceleration, planned.motion.limits.jerk
    for row, values, limit in zip(
        rows[1:], (curves.acceleration, curves.jerk), limits, strict=True
    ):
        shown = np.abs(values) if many else values
        for k, name in enumerate(axes):
            draw_curve(row, curves.along, shown[:, k], colours[name], 1.0, name)
            for sign in [1] if many else [-1, 1]:
                row.axhline(sign * limit[k], color=colours[name], ls="--", lw=0.8)
    if rapid.any():
        for row in rows:
            # A grey ground where the moves are rapid
            ends = _ends(planned)
            turns = np.flatnonzero(np.diff(np.concatenate([[False], rapid, [False]]).astype(int)))
            begins, lasts = ends[turns[::2]], ends[turns[1::2]]
            stretches = list(zip(begins, lasts - begins, strict=True))
            across = row.get_xaxis_transform()
            row.broken_barh(stretches, (0.0, 1.0), transform=across, color=SHADE, lw=0, zorder=0)
    legend_below(figure, columns=4)
    return figure


def _ends(planned: Planned) -> Float[np.ndarray, " ends"]:
    """Way at the beginnings of the pieces of the path, and at its end [mm]."""
    return 1e3 * np.append(0.0, np.cumsum(unpadded(planned.motion.path).extent))


def _curves(planned: Planned, rapid: Bool[np.ndarray, " P"]) -> _Curves:
    """The motion at the ends of its smooth parts, evenly in time, and evenly along the way."""
    motion, ends = planned.motion, _ends(planned)
    even = motion.reached(1e-3 * np.linspace(0.0, ends[-1], IN_A_COLUMN * COLUMNS))
    time = np.union1d(motion.nodes, np.linspace(0.0, motion.duration, POINTS))
    time = np.union1d(time, even)
    along = 1e3 * np.maximum.accumulate(motion.at(time).arc)
    speed, acceleration, jerk = motion.axes_at(time)
    on = [
        rapid[np.clip(np.searchsorted(ends, along + beside, side="right") - 1, 0, rapid.size - 1)]
        for beside in (-1e3 * ON_BORDER, 1e3 * ON_BORDER)
    ]
    fed = np.linalg.norm(speed, axis=1) / MM_PER_MIN
    return _Curves(along, fed, acceleration, jerk, ~on[0] | ~on[1], on[0] | on[1])


def _draw_feed(
    axes: Axes, planned: Planned, curves: _Curves, rapid: Bool[np.ndarray, " P"]
) -> None:
    """Feed of the cuts, of the rapid moves, and the one that is asked for; below, the stops.

    There the tool stops or waits, each with how often.
    """
    asked = planned.motion.feed / MM_PER_MIN
    cut_feed = np.where(curves.cut, curves.fed, np.nan)
    most = max(np.nanmax(cut_feed), asked[~rapid].min())
    top = (1 + MARGIN) * most
    if rapid.any():
        fastest = curves.fed[curves.rapid].max()
        off = fastest > TOP * most
        top = (1 + MARGIN) * (TOP * most if off else max(most, fastest))
        words = f"rapid, up to {fastest:,.0f} mm/min{' (cut off)' if off else ''}"
        rapid_feed = np.where(curves.rapid, curves.fed, np.nan)
        draw_curve(axes, curves.along, rapid_feed, RAPID, 1.0, words)
    draw_curve(axes, curves.along, cut_feed, DESIRED, 1.0, "feed")
    asked = np.where(rapid, np.nan, asked)
    axes.stairs(asked, _ends(planned), baseline=None, color=OTHER, ls="--", label="feed asked for")
    axes.set_ylim(-MARKS * top, top)
    axes.set_yticks([tick for tick in axes.get_yticks() if 0 <= tick <= top])
    motion, rests = planned.motion, planned.rests
    waits = rests.begin[rests.lasting > 0]
    strip = {"ls": "", "color": "black", "ms": 6.0, "transform": axes.get_xaxis_transform()}
    stops = 1e3 * motion.stops[1:-1]
    if stops.size:
        label = f"stops: {stops.size:,}"
        axes.plot(stops, 0.0 * stops + STOP, marker="|", mew=0.7, label=label, **strip)
    if waits.size:
        held = 1e3 * motion.at(waits).arc
        label = f"waits: {held.size:,}, {rests.total:.4g} s"
        axes.plot(held, 0.0 * held + WAIT, marker=CARETUP, label=label, **strip)
