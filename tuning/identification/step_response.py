"""A first-order axis with delay, fitted to a record of its control and its position.

    y(t) = (K exp(-L s) / (s (T s + 1))) u + y_0 + v_0 t + c exp(-t/T)     the drive takes a speed
    y(t) = (K exp(-L s) / (T s + 1)) u + y_0 + c exp(-t/T)                 or a position
The terms behind u are the motion before the record. For every delay L and time constant T all is
linear: K, y_0, v_0 and c are found by least squares, L and T by a search, a grid and then
Gauss-Newton from its best point. The control is held between its samples; a step is the usual one,
but any that changes will do.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.signal import lfilter, ss2tf

from jcontour.linear.continuous_axes import position_axis, sampled_axis, speed_axis

Takes = Literal["speed", "position"]
FEWEST = 20  # samples
GRID = 12  # points of the first search for each of the two


@dataclass(frozen=True)
class FittedStep:
    """What a record says about its axis."""

    gain: float  # K [m/s, or m, per unit of control]
    time_constant: float  # T [s]
    delay: float  # L [s]
    residual: float  # root mean square of what the model does not explain [m]
    explained: float  # part of the variance that it explains, at most one
    output: Float[np.ndarray, " T"]  # of the model (T,) [m]


def fit_step(
    control: Float[np.ndarray, " T"], position: Float[np.ndarray, " T"], dt: float, takes: Takes
) -> FittedStep:
    """Gain, time constant and delay of an axis from one record.

    Args:
        control: u, held over each sample.
        position: y [m].
        dt: sample period [s].
        takes: what the drive takes.

    Raises:
        ValueError: the record is too short, a signal does not change, a number is not finite, or
            the position falls where the control rises.
    """
    _check(control, position)
    span = dt * len(control)
    change, time = control - control[0], dt * np.arange(len(control))

    def rows(T: float, L: float) -> np.ndarray:
        columns = [_response(change, T, L, dt, takes), np.ones(len(control)), np.exp(-time / T)]
        if takes == "speed":
            columns.append(time)
        return np.stack(columns, axis=1)

    def misses(parameters: np.ndarray) -> np.ndarray:
        T, L = np.exp(parameters[0]), max(parameters[1], 0.0)
        basis = rows(T, L)
        found, *_ = np.linalg.lstsq(basis, position, rcond=None)
        return basis @ found - position

    constants = np.log(np.geomspace(0.5 * dt, 0.3 * span, GRID))
    delays = np.linspace(0.0, min(0.25 * span, 60 * dt), GRID)
    best = min(
        (np.array([T, L]) for T in constants for L in delays),
        key=lambda parameters: float(np.sum(misses(parameters) ** 2)),
    )
    scale = max(float(np.ptp(position)), 1e-30)
    found = least_squares(
        lambda parameters: misses(parameters) / scale, best, x_scale=[0.1, dt], diff_step=1e-4
    )
    T, L = float(np.exp(found.x[0])), max(float(found.x[1]), 0.0)
    basis = rows(T, L)
    numbers, *_ = np.linalg.lstsq(basis, position, rcond=None)
    if not numbers[0] > 0:
        raise ValueError("position: it falls where the control rises; change the sign of one")
    output = basis @ numbers
    missed = output - position
    return FittedStep(
        gain=float(numbers[0]),
        time_constant=T,
        delay=L,
        residual=float(np.sqrt(np.mean(missed**2))),
        explained=1 - float(np.var(missed) / np.var(position)),
        output=output,
    )


def _response(control: np.ndarray, T: float, L: float, dt: float, takes: Takes) -> np.ndarray:
    """Position of an axis of gain one, from rest at zero."""
    make = speed_axis if takes == "speed" else position_axis
    A, B, C, late = sampled_axis(make(1.0, T, L), dt)
    u = np.concatenate([np.zeros(late), control])[: len(control)]
    above, below = ss2tf(A, B, C, np.zeros((1, 1)))
    return np.asarray(lfilter(above[0], below, u))


def _check(control: np.ndarray, position: np.ndarray) -> None:
    if len(control) < FEWEST:
        raise ValueError(f"record: needs at least {FEWEST} samples, received {len(control)}")
    for name, values in (("control", control), ("position", position)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name}: needs finite numbers, received NaN or inf")
        if np.ptp(values) == 0:
            raise ValueError(f"{name}: it never changes, so nothing can be seen")
