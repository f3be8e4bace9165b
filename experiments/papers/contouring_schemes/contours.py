"""Contours on which contouring schemes are tuned and compared, and the runs along them."""

import numpy as np

from jcontour.app.machines.flexible_axis import SAMPLE
from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import circle, ellipse, lemniscate, polygon, spline
from jcontour.motion.feed_laws import trapezoidal
from jcontour.motion.references import Reference, along
from jcontour.simulation.evaluation import stack_references

FEED = 0.05  # [m/s]; the thesis asks 0.1 of its axis
ACCELERATION = 1.0  # [m/s^2]; the thesis asks 4 of its axis
SETTLING = 0.2  # [s] that the tool is given, and scored, after its reference has come to the end


def training() -> dict[str, Contour]:
    """A circle, and lines in four directions with corners between them."""
    rhombus = polygon(1e-3 * np.array([[0.0, 0.0], [22.0, 8.0], [30.0, 30.0], [8.0, 22.0]]))
    return {"circle": circle(15e-3), "rhombus": rhombus}


def held_out() -> dict[str, Contour]:
    """Contours that the tuner never sees: other curvatures, directions and a crossing."""
    points = [[0.0, 0.0], [12.0, 16.0], [30.0, -6.0], [48.0, 12.0], [60.0, 0.0]]  # [mm]
    wave = spline(1e-3 * np.array(points))
    return {"ellipse": ellipse(25e-3, 12e-3), "figure of eight": lemniscate(25e-3), "wave": wave}


def run_along(contour: Contour) -> Reference:
    """From rest to rest, and time to settle."""
    arc = trapezoidal(contour, FEED, SAMPLE, ACCELERATION)
    rest = np.full(round(SETTLING / SAMPLE), arc[-1])
    return along(contour, np.append(arc, rest), SAMPLE, 1, at_rest=True)


def references(contours: dict[str, Contour]) -> Reference:
    """References along all of them, stacked."""
    return stack_references([run_along(contour) for contour in contours.values()])
