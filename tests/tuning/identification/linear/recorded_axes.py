"""Simulated records: an axis under a cascade of its own, as a log of its drive shows it.

The cascade is what a machine has before it is tuned: a proportional position loop for a drive that
takes a speed, speed and position loops for one that takes a force, and little beside the reference
itself for one that takes a position. The position is counted, and something unknown comes to the
command.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from jcontour.linear.continuous_axes import ContinuousAxis, sampled_axis

Takes = Literal["speed", "position", "force"]
PARTS = 10  # of a sample in which dry friction is one number
FEEDBACK = 0.2  # [command per m] of a drive that closes its own position loop


@dataclass(frozen=True)
class RecordedAxis:
    """One axis in closed loop."""

    axis: ContinuousAxis  # in continuous time, with its delay
    takes: Takes  # what its drive takes
    count: float  # of its encoder [m]
    noise: float  # standard deviation of the position before it is counted [m]
    # standard deviation of what comes to the command on the way, over the command's
    disturbance: float
    # gains of the cascade: of the position, and of the speed where the drive takes a force
    loop: tuple[float, ...]
    # command that dry friction takes while the axis moves, and at most while it sticks; of an axis
    # whose command acts on the speed that is recorded
    friction: float = 0.0


def recorded(
    one: RecordedAxis,
    reference: Float[np.ndarray, " T"],
    dt: float,
    random: np.random.Generator,
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]:
    """Command and measured position while the axis follows a reference under its own cascade."""
    A, B, C, late = sampled_axis(one.axis, dt)
    rows = len(reference)
    x, line = np.zeros(len(A)), [0.0] * (late + 1)
    u, y = np.zeros(rows), np.zeros(rows)
    noise = one.noise * random.standard_normal(rows)
    law = _law(one, dt)
    scale = 0.0
    shocks = random.standard_normal(rows)
    b, c = B[:, 0], C[0]
    move = _rubbed(one, dt) if one.friction else lambda x, command: A @ x + b * command
    for k in range(rows):
        y[k] = one.count * np.round((c @ x + noise[k]) / one.count)
        u[k] = law(reference[k], y[k])
        scale = max(scale, abs(u[k]))
        line = [u[k] + one.disturbance * scale * shocks[k], *line[:-1]]
        x = move(x, line[late])
    return u, y


def _rubbed(one: RecordedAxis, dt: float) -> Callable[[np.ndarray, float], np.ndarray]:
    """A sample of an axis with dry friction: in each part what stops the axis, at most F.

    Raises:
        ValueError: the command does not act on the speed.
    """
    if not (one.axis.C @ one.axis.A @ one.axis.B).item() > 0:
        raise ValueError("friction: the command needs to act on the speed")
    A, B, _, _ = sampled_axis(replace(one.axis, delay=0.0), dt / PARTS)
    b, speed, most = B[:, 0], one.axis.C[0] @ one.axis.A, one.friction
    pushed = float(speed @ b)

    def moved(x: np.ndarray, command: float) -> np.ndarray:
        for _ in range(PARTS):
            x = A @ x + b * command
            x = x - b * min(max(float(speed @ x) / pushed, -most), most)
        return x

    return moved


def _law(one: RecordedAxis, dt: float) -> Callable[[float, float], float]:
    if one.takes == "position":
        return lambda r, y: one.loop[0] * r + FEEDBACK * (r - y)
    if one.takes == "speed":
        return lambda r, y: one.loop[0] * (r - y)
    outer, inner = one.loop
    before = 0.0

    def cascade(r: float, y: float) -> float:
        nonlocal before
        speed, before = (y - before) / dt, y
        return inner * (outer * (r - y) - speed)

    return cascade
