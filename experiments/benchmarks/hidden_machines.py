"""Random axes whose records are all that an identification sees, and which then tell the truth."""

import numpy as np

from jcontour.linear.continuous_axes import (
    force_axis,
    position_axis,
    speed_axis,
    with_resonance,
)
from tuning.identification.linear.recording import RecordedAxis, Takes

KINDS: tuple[Takes, ...] = ("speed", "position", "force")
COUNTS = (0.1e-6, 1e-6)  # encoder [m]


def hidden_axis(random: np.random.Generator, dt: float) -> RecordedAxis:
    """A random axis with a cascade that is stable with room."""
    kind = KINDS[int(random.integers(len(KINDS)))]
    delay = dt * float(random.integers(4))
    constant = float(np.exp(random.uniform(np.log(4e-3), np.log(40e-3))))
    gain = float(np.exp(random.uniform(np.log(0.5), np.log(2.0))))
    if kind == "speed":
        axis = speed_axis(gain, constant, delay)
        bandwidth = 0.25 / (constant + delay + 2 * dt)
        loop = (bandwidth / gain,)
    elif kind == "position":
        axis = position_axis(gain, constant, delay)
        loop = (1.0 / gain,)
    else:
        mass, viscous = float(random.uniform(20, 150)), float(random.uniform(50, 400))
        force = 35 * gain
        axis = force_axis(force, mass, viscous, delay)
        inner = 0.2 / (delay + 2 * dt)
        loop = (inner / 5, inner * mass / force)
    if kind != "force" and random.uniform() < 0.3:
        axis = with_resonance(axis, 2 * np.pi * random.uniform(40, 90), random.uniform(0.05, 0.2))
    count = float(np.exp(random.uniform(*np.log(COUNTS))))
    return RecordedAxis(axis, kind, count, 0.5 * count, float(random.uniform(0, 0.003)), loop)
