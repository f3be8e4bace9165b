"""A small loop that learns, and the reference numbers of the textbook algorithms."""

import numpy as np
import pytest

DT = 5e-3  # [s]


@pytest.fixture(scope="session")
def small_loop():
    """steps -> two servos, their cascade and a quarter of a circle of 10 mm, from rest to rest."""
    # imported here: conftest files are read before the number of devices is set
    from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
    from jcontour.motion.references import from_samples
    from jcontour.plants.linear_machines import servo_axes
    from jcontour.sensors import Sensors

    def of(steps=120, gains=None):
        plant = servo_axes([50.0, 30.0], [10.0, 5.0], DT)
        loops = CascadeGains(8.0, np.array([0.6, 0.9]), 0.1) if gains is None else gains
        share = np.clip((np.arange(steps + 1) - 10) / (steps - 60), 0, 1)
        angle = np.pi / 2 * (share - np.sin(2 * np.pi * share) / (2 * np.pi))
        position = 1e-2 * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
        tangent = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        reference = from_samples(position, tangent, DT, preview=1, in_motion=False)
        return plant, Cascade(loops, Sensors((0, 2), (1, 3)), DT), reference

    return of


@pytest.fixture(scope="session")
def positions():
    """Positions of two servos from their state."""
    return lambda measurement: measurement[..., ::2]
