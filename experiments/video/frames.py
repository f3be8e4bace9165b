"""Frames of a gantry's video: MuJoCo's picture, plan of the path, twist and contour error.

The twist theta is drawn n times as large, about the tool, which stays where it is: the pose (x_h,
y_N, n theta) whose tool is at P_e of `parameters`. The contour error is magnified in the
plan.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.text import Text

from experiments.video.film import Film
from jcontour.plants.gantry.parameters import GantryParameters

TWIST_SHOWN = 0.08  # [rad] at most, magnified: 4.6 degrees
ERROR_SHOWN = 0.06  # at most, magnified, of the contour's size
LARGEST_FACTOR = 1_000_000  # beyond it one sees rounding
ROUND = (1.0, 2.0, 5.0, 10.0)
PICTURE = (960, 380)  # [pixels] of the machine
SIZE, DPI = (960, 672), 100  # [pixels] of a frame: whole blocks of a codec


def twist_factor(film: Film) -> int:
    """Factor by which the twist is magnified."""
    return magnification(np.abs(film.pose[:, 2]).max(), TWIST_SHOWN)


def error_factor(film: Film) -> int:
    """Factor by which the contour error is magnified."""
    largest = np.linalg.norm(film.error, axis=1).max()
    return magnification(largest, ERROR_SHOWN * np.ptp(film.path, axis=0).max())


def magnification(peak: float, shown: float) -> int:
    """Largest factor 1, 2, 5, 10, 20, ... under which the peak is at most `shown`.

    It is at least 1 and at most `LARGEST_FACTOR`.
    """
    if peak * LARGEST_FACTOR <= shown:
        return LARGEST_FACTOR
    return max(1, round(1 / least_round(peak / shown)))


def least_round(value: float) -> float:
    """Least of ..., 0.5, 1, 2, 5, 10, 20, ... that is at least a value above zero."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in ROUND if step * power >= value * (1 - 1e-12)))


def posed(parameters: GantryParameters, tool: np.ndarray, twist: float) -> np.ndarray:
    """(x_h, y_N, theta) that has the tool [m] there with the beam turned by `twist` [rad]."""
    (x, y), d, sine, cosine = tool, float(parameters.tool_offset), np.sin(twist), np.cos(twist)
    head = (x - d * sine) / cosine
    return np.array([head, y - head * sine + d * cosine, twist])


class Frames:
    """Pictures of a film, sample by sample.

    Args:
        scene: a `gantry_scene.Scene`, or whatever has its `picture`.
        parameters: of the machine.
        film: its poses are (x_h, y_N, theta) [m, m, rad].
        pace: speed of the video, in words.
    """

    def __init__(self, scene: Any, parameters: GantryParameters, film: Film, pace: str):
        self._scene, self._parameters, self._film, self._pace = scene, parameters, film, pace
        figure = Figure(figsize=(SIZE[0] / DPI, SIZE[1] / DPI), dpi=DPI, layout="constrained")
        self._canvas = FigureCanvasAgg(figure)
        mosaic: Any = [["machine", "machine"], ["plan", "twist"], ["plan", "error"]]
        panels = figure.subplot_mosaic(
            mosaic, height_ratios=(PICTURE[1] / 120, 1, 1), width_ratios=(1, 2.2)
        )
        self._machine, self._heading = _machine_panel(panels["machine"])
        self._trace = 1e3 * (film.tool + (error_factor(film) - 1) * film.error)
        self._traced, self._tip = _plan_panel(panels["plan"], film, self._trace)
        self._signals = 1e6 * film.pose[:, 2], 1e6 * np.linalg.norm(film.error, axis=1)
        self._lines = [
            _signal_panel(panels[name], film.time, v)
            for name, v in zip(("twist", "error"), self._signals, strict=True)
        ]
        panels["twist"].set(ylabel="twist [urad]")
        panels["twist"].tick_params(labelbottom=False)
        panels["error"].set(ylabel="contour error [um]", xlabel="time [s]", ylim=(0, None))
        self._canvas.draw()  # without what moves
        self._still = self._canvas.copy_from_bbox(figure.bbox)

    @property
    def title(self) -> str:
        """Heading of the frame."""
        return self._heading.get_text()

    def pixels(self, sample: int) -> np.ndarray:
        """Pixels (height, width, 3) of the frame at a sample."""
        film, seen = self._film, slice(0, sample + 1)
        pose = posed(self._parameters, film.tool[sample], twist_factor(film) * film.pose[sample, 2])
        straight = film.tool[sample, 1] + float(self._parameters.tool_offset)
        self._machine.set_data(self._scene.picture(pose, straight))
        time = f"t = {film.time[sample]:.3f} s, {self._pace}"
        self._heading.set_text(f"{film.title}    {time}    twist x {twist_factor(film):,}")
        self._traced.set_data(*self._trace[seen].T)
        self._tip.set_data(*self._trace[sample : sample + 1].T)
        for line, values in zip(self._lines, self._signals, strict=True):
            line.set_data(film.time[seen], values[seen])
        self._canvas.restore_region(self._still)
        for artist in (self._machine, self._heading, self._traced, self._tip, *self._lines):
            self._canvas.figure.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()


def _machine_panel(axes: Axes) -> tuple[AxesImage, Text]:
    axes.set_axis_off()
    axes.set_title(" ")  # its room
    white = np.full((*PICTURE[::-1], 3), 255, np.uint8)
    picture = axes.imshow(white, interpolation="nearest", animated=True)
    heading = axes.text(0.5, 1.01, "", ha="center", va="bottom", fontsize=12, animated=True)
    heading.set_transform(axes.transAxes)
    return picture, heading


def _plan_panel(axes: Axes, film: Film, trace: np.ndarray) -> tuple[Line2D, Line2D]:
    axes.plot(*(1e3 * film.path).T, color="0.55", linewidth=2.0)
    shown = np.vstack([trace, 1e3 * film.path])
    axes.set(
        aspect="equal",
        xlim=_padded(shown[:, 0]),
        ylim=_padded(shown[:, 1]),
        xlabel="x [mm]",
        ylabel="y [mm]",
    )
    axes.set_title(f"contour error x {error_factor(film):,}", fontsize=11)
    (traced,) = axes.plot([], [], color="C1", linewidth=1.1, animated=True)
    (tip,) = axes.plot([], [], "o", color="C1", animated=True)
    return traced, tip


def _signal_panel(axes: Axes, time: np.ndarray, values: np.ndarray) -> Line2D:
    axes.plot(time, values, color="0.85", linewidth=0.9)
    axes.set_xlim(time[0], time[-1])
    axes.grid(color="0.93")
    return axes.plot([], [], color="C3", linewidth=1.1, animated=True)[0]


def _padded(values: np.ndarray) -> tuple[float, float]:
    """Ends of an axis with room around."""
    low, high = values.min(), values.max()
    room = 0.06 * max(high - low, 1e-3)
    return low - room, high + room
