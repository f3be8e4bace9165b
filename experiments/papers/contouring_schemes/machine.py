"""Models of the biaxial machine on which contouring schemes are compared, and its contours."""

from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np

from experiments.machines.flexible_axis import biaxial_axes, scaled
from jcontour.geometry.contour import Contour
from jcontour.geometry.contours import circle, ellipse, lemniscate, polygon, spline
from jcontour.motion.feed_laws import trapezoidal
from jcontour.motion.references import Reference, along
from jcontour.plant import Plant
from jcontour.plants.flexible_axis.axis import AxisParameters, FlexibleAxis, SmoothFlexibleAxis
from jcontour.plants.wrappers.delays import Delayed
from jcontour.simulation.evaluation import stack_plants, stack_references

DT = 1e-3  # [s] of the thesis's controllers
FEED, ACCELERATION = (
    0.05,
    1.0,
)  # [m/s], [m/s^2] within what the thesis asks of its axis, 0.1 m/s and 4 m/s^2
SETTLING = 0.2  # [s] that the tool is given, and scored, after its reference has come to the end
# of the smooth twin while it is tuned: four change its errors by 5e-6; the true plant takes its 20
SUBSTEPS = 2

LATE = "one sample late"
MODEL_ERRORS = {  # factors on stiffness and masses, samples that the control is late
    "nominal": (1.0, 1.0, 0),
    LATE: (1.0, 1.0, 1),
    "heavy and soft": (0.8, 1.2, 0),
    "light and stiff": (1.2, 0.8, 0),
}
TUNED_ON = ("nominal", LATE)  # without the late one the velocity gains would grow until they ring


def smooth_family(names: Sequence[str]) -> Plant:
    """Smooth twins, to tune on."""
    return _family(names, lambda p: SmoothFlexibleAxis(p, DT, substeps=SUBSTEPS))


def true_family(names: Sequence[str]) -> Plant:
    """Machines with stick and slip."""
    return _family(names, lambda p: FlexibleAxis(p, DT))


def _family(names: Sequence[str], axes: Callable[[AxisParameters], Plant]) -> Plant:
    errors = [MODEL_ERRORS[name] for name in names]
    return stack_plants(
        [
            Delayed(axes(scaled(biaxial_axes(), *factors)), jnp.asarray(late), 1, 2)
            for *factors, late in errors
        ]
    )


def training() -> dict[str, Contour]:
    """A circle, and lines in four directions with corners between them."""
    rhombus = polygon(1e-3 * np.array([[0.0, 0.0], [22.0, 8.0], [30.0, 30.0], [8.0, 22.0]]))
    return {"circle": circle(15e-3), "rhombus": rhombus}


def held_out() -> dict[str, Contour]:
    """What the tuner never sees: other curvatures, directions and a crossing."""
    wave = spline(
        1e-3 * np.array([[0.0, 0.0], [12.0, 16.0], [30.0, -6.0], [48.0, 12.0], [60.0, 0.0]])
    )
    return {"ellipse": ellipse(25e-3, 12e-3), "figure of eight": lemniscate(25e-3), "wave": wave}


def run_along(contour: Contour) -> Reference:
    """From rest to rest, and time to settle."""
    arc = trapezoidal(contour, FEED, DT, ACCELERATION)
    return along(
        contour, np.append(arc, np.full(round(SETTLING / DT), arc[-1])), DT, 1, at_rest=True
    )


def references(contours: dict[str, Contour]) -> Reference:
    """All of them, stacked."""
    return stack_references([run_along(contour) for contour in contours.values()])
