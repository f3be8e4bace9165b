"""Loops for the contouring schemes: the linear X-Y table, whose encoders see the tool."""

from types import SimpleNamespace

import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.geometry.contours import circle, line
from jcontour.motion.references import along
from jcontour.plants.xy_table import X_DRIVE, xy_table
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate

DT, FEED, RADIUS = 1e-3, 0.05, 0.02
STEPS = 2000  # two seconds: transients of 25 rad/s are gone


def on_line(angle, steps=STEPS):
    contour = line([0.0, 0.0], 0.2 * np.array([np.cos(angle), np.sin(angle)]))
    return along(contour, FEED * DT * np.arange(steps), DT, 1, at_rest=False)


def on_circle(clockwise=False, steps=STEPS):
    return along(
        circle(RADIUS, clockwise=clockwise), FEED * DT * np.arange(steps), DT, 1, at_rest=False
    )


def cascade(position=(25.0, 25.0), feedforward=0.0):
    gains = CascadeGains(np.array(position), 10.0, 0.05, feedforward)
    return Cascade(gains, Sensors((2, 6), (1, 5), 0.7958e-3), DT)


def last_error(plant, controller, reference):
    """r - y at the last sample [m]."""
    run = simulate(plant, controller, reference)
    return np.asarray(reference.position)[reference.steps - 1] - np.asarray(run.output)[-1]


@pytest.fixture(scope="session")
def table():
    """The plant, one with equal axes, and what makes references and cascades for it."""
    return SimpleNamespace(
        plant=xy_table(DT),
        equal=xy_table(DT, (X_DRIVE, X_DRIVE)),
        feed=FEED,
        radius=RADIUS,
        dt=DT,
        on_line=on_line,
        on_circle=on_circle,
        cascade=cascade,
        last_error=last_error,
    )
