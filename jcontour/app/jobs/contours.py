"""Built-in contours, and motions of a single axis.

Contours are for small machines, for flexible axes, and along the gantry's beam.
"""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from jcontour.app.jobs.job import TOOLPATHS, AxisMove, Job, Pace, Task, along_contour, from_file
from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import circle, ellipse, lemniscate, line, polygon, spline
from jcontour.geometry.periodic_splines import polar_lobes
from jcontour.motion.point_to_point import PointToPoint, ToAndFro
from jcontour.motion.references import TimeLaw

# points [m] by their angles
Outline = Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, "2 n"]]
BEAM_FEED = 0.3  # [m/s] along the gantry's beam
BEAM_POINTS = 48  # that a spline goes through
DWELL = 0.1  # [s] of rest before every motion of the thesis
SETTLING = 1.075  # [s] of rest after its task A


def square(pace: Pace) -> Job:
    """Square with sides of 2 mm."""
    corners = [[0.0, 0.0], [2e-3, 0.0], [2e-3, 2e-3], [0.0, 2e-3]]
    return along_contour("square", polygon(corners), pace)


def wave(pace: Pace) -> Job:
    """Open wave, 6 mm long."""
    points = [[0.0, 0.0], [1e-3, 1.5e-3], [3e-3, -0.5e-3], [4.5e-3, 1e-3], [6e-3, 0.0]]
    return along_contour("wave", spline(points), pace)


def ring(pace: Pace) -> Job:
    """Circle of 50 mm diameter."""
    return along_contour("ring", circle(25e-3), pace)


def rounded_square(pace: Pace) -> Job:
    """Square of 50 mm with rounded corners."""
    x = [1, 0.9, 0, -0.9, -1, -0.9, 0, 0.9, 1]
    y = [0, 0.9, 1, 0.9, 0, -0.9, -1, -0.9, 0]
    points = 25e-3 * np.array([x, y]).T
    return along_contour("rounded-square", spline(points), pace)


def along_the_beam(name: str, x: float, outline: Outline) -> Callable[[Pace], Job]:
    """Maker of a smooth closed contour around x [m].

    Its feed is `BEAM_FEED` unless another one is given.
    """

    def make(pace: Pace) -> Job:
        around = np.linspace(0.0, 2 * np.pi, BEAM_POINTS, endpoint=False)
        contour = spline(outline(around).T + np.array([x, 0.0]), closed=True)
        return along_contour(name, contour, pace._replace(feed=pace.feed or BEAM_FEED))

    return make


def ring_outline(angle: np.ndarray) -> np.ndarray:
    """Circle."""
    return 0.05 * np.array([np.cos(angle), np.sin(angle)])


def cushion_outline(angle: np.ndarray) -> np.ndarray:
    """Circle with four dents."""
    return ring_outline(angle) * (1 - 0.12 * np.cos(4 * angle))


def eight_outline(angle: np.ndarray) -> np.ndarray:
    """Figure of eight."""
    return (
        0.08 / (1 + np.sin(angle) ** 2) * np.array([np.cos(angle), np.cos(angle) * np.sin(angle)])
    )


def oval_outline(angle: np.ndarray) -> np.ndarray:
    """Ellipse across the beam."""
    return np.array([[0.03], [0.05]]) * np.array([np.cos(angle), np.sin(angle)])


def _along(name: str, contour: Callable[[], Contour]) -> Callable[[Pace], Job]:
    return lambda pace: along_contour(name, contour(), pace)


def task_a(pace: Pace) -> AxisMove:
    """Task A of Yuan, section 3.4.1: 0.1 m from rest to rest, and a second of rest.

    Feed is 0.1 m/s and acceleration 4 m/s^2 unless another pace is given.
    """
    return _point_to_point("task-a", pace, 0.1, 0.1, 4.0)


def s_curve(pace: Pace) -> AxisMove:
    """Half the way at twice the speed, with limited jerk."""
    return _point_to_point("s-curve", pace, 0.05, 0.2, 4.0, jerk=100.0)


def task_b(pace: Pace) -> AxisMove:
    """Task B of Yuan, section 3.4.1: 0.05 cos(2 t) + 0.05 m."""
    if pace.feed is not None or pace.acceleration is not None:
        raise ValueError(
            "feed-mm-per-min, acceleration: task-b is a cosine with a speed of its own; "
            "leave them out"
        )
    return _motion("task-b", pace, line([0.1], [0.0]), ToAndFro(0.1, 2.0), 3.3, "cosine, 2 rad/s")


def _point_to_point(
    name: str, pace: Pace, distance: float, feed: float, acceleration: float, jerk: float = np.inf
) -> AxisMove:
    feed, acceleration = pace.feed or feed, pace.acceleration or acceleration
    law = PointToPoint(distance, feed, acceleration, jerk)
    shape = "trapezoidal" if np.isinf(jerk) else "S-curve"
    words = f"{shape}, {feed:g} m/s, {acceleration:g} m/s^2"
    return _motion(name, pace, line([0.0], [distance]), law, DWELL + law.duration + SETTLING, words)


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
    "square": square,
    "ellipse": _along("ellipse", lambda: ellipse(3e-3, 1.5e-3)),
    "lemniscate": _along("lemniscate", lambda: lemniscate(3e-3)),
    "wave": wave,
    "bracket": lambda pace: from_file(TOOLPATHS / "bracket.ngc", pace),
    "cam": lambda pace: from_file(TOOLPATHS / "cam.ngc", pace),
    "lobes": _along("lobes", lambda: polar_lobes(30e-3, 10e-3, 4)),
    "ring": ring,
    "rounded-square": rounded_square,
    "ring-left": along_the_beam("ring-left", -0.55, ring_outline),
    "ring-centre": along_the_beam("ring-centre", 0.0, ring_outline),
    "cushion-left": along_the_beam("cushion-left", -0.3, cushion_outline),
    "oval-centre": along_the_beam("oval-centre", 0.05, oval_outline),
    "cushion-right": along_the_beam("cushion-right", 0.4, cushion_outline),
    "eight-right": along_the_beam("eight-right", 0.7, eight_outline),
    "task-a": task_a,
    "task-b": task_b,
    "s-curve": s_curve,
}
