"""Built-in contours, and motions of a single axis.

Contours are for small machines, for flexible axes, and along the gantry's beam.
"""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from jcontour.app.jobs.job import TOOLPATHS, AxisMove, Job, Pace, Task, along_contour, from_file
from jcontour.app.plain_numbers import feed_words
from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import circle, ellipse, lemniscate, line, polygon, spline
from jcontour.geometry.periodic_splines import polar_lobes
from jcontour.motion.point_to_point import PointToPoint, ToAndFro
from jcontour.motion.references import TimeLaw

# points [m] by their angles
Outline = Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, "2 n"]]
BEAM_FEED = 0.3  # [m/s] along the gantry's beam, unless another one is given
BEAM_POINTS = 48  # that a spline goes through
DWELL = 0.1  # [s] of rest before every motion of the thesis
SETTLING = 1.075  # [s] of rest after its task A
SQUARE = [[0.0, 0.0], [2e-3, 0.0], [2e-3, 2e-3], [0.0, 2e-3]]  # corners [m]
WAVE = [[0.0, 0.0], [1e-3, 1.5e-3], [3e-3, -0.5e-3], [4.5e-3, 1e-3], [6e-3, 0.0]]
ROUNDED = 25e-3 * np.array(
    [[1, 0], [0.9, 0.9], [0, 1], [-0.9, 0.9], [-1, 0], [-0.9, -0.9], [0, -1], [0.9, -0.9], [1, 0]]
)


def ring(angle: np.ndarray) -> np.ndarray:
    """Circle."""
    return 0.05 * np.array([np.cos(angle), np.sin(angle)])


def cushion(angle: np.ndarray) -> np.ndarray:
    """Circle with four dents."""
    return ring(angle) * (1 - 0.12 * np.cos(4 * angle))


def eight(angle: np.ndarray) -> np.ndarray:
    """Figure of eight."""
    return (
        0.08 / (1 + np.sin(angle) ** 2) * np.array([np.cos(angle), np.cos(angle) * np.sin(angle)])
    )


def oval(angle: np.ndarray) -> np.ndarray:
    """Ellipse across the beam."""
    return np.array([[0.03], [0.05]]) * np.array([np.cos(angle), np.sin(angle)])


def _along(name: str, contour: Callable[[], Contour]) -> Callable[[Pace], Job]:
    return lambda pace: along_contour(name, contour(), pace)


def _on_beam(name: str, x: float, outline: Outline) -> Callable[[Pace], Job]:
    """Maker of a smooth closed contour around x [m]."""

    def make(pace: Pace) -> Job:
        around = np.linspace(0.0, 2 * np.pi, BEAM_POINTS, endpoint=False)
        contour = spline(outline(around).T + np.array([x, 0.0]), closed=True)
        return along_contour(name, contour, pace._replace(feed=pace.feed or BEAM_FEED))

    return make


def task_b(pace: Pace) -> AxisMove:
    """Task B of Yuan, section 3.4.1: 0.05 cos(2 t) + 0.05 m."""
    if pace.feed is not None or pace.acceleration is not None:
        raise ValueError(
            "feed-mm-per-min, acceleration: task-b is a cosine with a speed of its own; "
            "leave them out"
        )
    return _motion("task-b", pace, line([0.1], [0.0]), ToAndFro(0.1, 2.0), 3.3, "cosine, 2 rad/s")


def _point_to_point(
    name: str, distance: float, feed: float, acceleration: float, jerk: float = np.inf
) -> Callable[[Pace], AxisMove]:
    """Maker of a motion from rest to rest, at its own feed and acceleration where none is given."""

    def make(pace: Pace) -> AxisMove:
        used = pace.feed or feed, pace.acceleration or acceleration
        law = PointToPoint(distance, *used, jerk)
        shape = "trapezoidal" if np.isinf(jerk) else "S-curve"
        words = f"{shape}, {feed_words(used[0])}, {used[1]:g} m/s^2"
        duration = DWELL + law.duration + SETTLING
        return _motion(name, pace, line([0.0], [distance]), law, duration, words)

    return make


def _motion(
    name: str, pace: Pace, contour: Contour, law: TimeLaw, duration: float, words: str
) -> AxisMove:
    dt = pace.machine.model.dt
    axes = len(pace.machine.axes)
    if axes != 1:
        raise ValueError(
            f"contour: {name} is a motion of a single axis, {pace.machine.name} has {axes}"
        )
    return AxisMove(name, contour, law, dt * math.ceil(duration / dt - 1e-6), DWELL, dt, words)


BUILT_IN: dict[str, Callable[[Pace], Task]] = {  # the lines that describe them: the catalogue's
    "circle": _along("circle", lambda: circle(1e-3)),
    "square": _along("square", lambda: polygon(SQUARE)),
    "ellipse": _along("ellipse", lambda: ellipse(3e-3, 1.5e-3)),
    "lemniscate": _along("lemniscate", lambda: lemniscate(3e-3)),
    "wave": _along("wave", lambda: spline(WAVE)),
    "bracket": lambda pace: from_file(TOOLPATHS / "bracket.ngc", pace),
    "cam": lambda pace: from_file(TOOLPATHS / "cam.ngc", pace),
    "lobes": _along("lobes", lambda: polar_lobes(30e-3, 10e-3, 4)),
    "ring": _along("ring", lambda: circle(25e-3)),
    "rounded-square": _along("rounded-square", lambda: spline(ROUNDED)),
    "ring-left": _on_beam("ring-left", -0.55, ring),
    "ring-centre": _on_beam("ring-centre", 0.0, ring),
    "cushion-left": _on_beam("cushion-left", -0.3, cushion),
    "oval-centre": _on_beam("oval-centre", 0.05, oval),
    "cushion-right": _on_beam("cushion-right", 0.4, cushion),
    "eight-right": _on_beam("eight-right", 0.7, eight),
    # Task A of Yuan, section 3.4.1: 0.1 m from rest to rest, and a second of rest
    "task-a": _point_to_point("task-a", 0.1, feed=0.1, acceleration=4.0),
    "task-b": task_b,
    # half the way at twice the speed, with limited jerk
    "s-curve": _point_to_point("s-curve", 0.05, feed=0.2, acceleration=4.0, jerk=100.0),
}
