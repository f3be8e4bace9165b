"""Adaptive synchronisation of two axes in continuous time, integrated on the host.

Tomizuka, Hu, Chiu & Kamano (1990), eqs. 6-8, with C = [[1 + beta, -beta], [-beta, 1 + beta]]:

    w_i' = -a_i w_i + b_i (u_i + d_i),     e_i = w_d - w_i,     e* = C e
    u_i = k_c,i e*_i + theta_i . phi,      theta_i' = gamma phi e*_i,     phi = (w_d, w_d', v_c)
The speeds start at w_d, the estimates where they fit the axes without load.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp

from jcontour.controllers.synchronisation.speed_axes import SpeedAxes

ACCURACY = 1e-12  # relative and absolute, of the integrator: results are good to 1e-10


class ContinuousGains(NamedTuple):
    """Gains of the law.

    Attributes:
        proportional: k_c of every axis (2,).
        adaptation: gamma.
        coupling: beta.
        bias: v_c.
    """

    proportional: Float[np.ndarray, "2"]
    adaptation: float
    coupling: float
    bias: float = 1.0


class Motion(NamedTuple):
    """What happens to the axes.

    Attributes:
        speed: w_d at a time [s].
        slope: its derivative.
        load: d of both axes at a time, in units of control.
        jumps: times at which one of them jumps; the integrator starts anew there.
    """

    speed: Callable[[float], float]
    slope: Callable[[float], float]
    load: Callable[[float], Float[np.ndarray, "2"]]
    jumps: Sequence[float] = ()


class Response(NamedTuple):
    """Errors and estimates of both axes at the instants asked for."""

    times: Float[np.ndarray, " S"]  # [s]
    error: Float[np.ndarray, "S 2"]
    estimate: Float[np.ndarray, "S 2 3"]


def coupling_matrix(coupling: float) -> Float[np.ndarray, "2 2"]:
    """C = [[1 + beta, -beta], [-beta, 1 + beta]]."""
    return np.eye(2) + coupling * np.array([[1.0, -1.0], [-1.0, 1.0]])


def continuous_response(
    axes: SpeedAxes, gains: ContinuousGains, motion: Motion, times: Float[np.ndarray, " S"]
) -> Response:
    """Response from time zero, at the instants `times` [s].

    >>> from jcontour.controllers.synchronisation.speed_axes import speed_axes
    >>> steady = Motion(lambda t: 1.0, lambda t: 0.0, lambda t: np.array([0.0, 1.0]))
    >>> gains = ContinuousGains(np.array([0.3, 0.3]), 11.0, 0.0)
    >>> run = continuous_response(speed_axes(10.0, [50.0, 50.0]), gains, steady, np.array([0.0]))
    >>> run.error.tolist()
    [[0.0, 0.0]]

    Raises:
        ValueError: there are not two axes, or the times do not increase from zero on.
        RuntimeError: the integrator gives up.
    """
    times = np.asarray(times, float)
    if len(axes.pole) != 2:
        raise ValueError(f"axes: synchronisation needs two, received {len(axes.pole)}")
    if times.size == 0 or times[0] < 0 or np.any(np.diff(times) <= 0):
        raise ValueError("times: need to increase, from zero on")
    slopes = _slopes(axes, gains, motion)
    start = np.concatenate([np.full(2, motion.speed(0.0)), axes.feedforward().ravel()])
    ends = [jump for jump in sorted(motion.jumps) if 0 < jump < times[-1]]
    rows, begin = [], 0.0
    for end in (*ends, times[-1]):
        inside = times[(times >= begin) & (times < end)]
        found = _integrated(slopes, start, begin, end, inside)
        rows.append(found[:-1])
        start, begin = found[-1], end
    state = np.concatenate([*rows, start[None]])
    wanted = np.array([motion.speed(t) for t in times])
    return Response(times, wanted[:, None] - state[:, :2], state[:, 2:].reshape(-1, 2, 3))


def _slopes(axes: SpeedAxes, gains: ContinuousGains, motion: Motion):
    """Right side of the differential equation; the load at a jump is that of after it."""
    C = coupling_matrix(gains.coupling)

    def slopes(t, state):
        speed, estimate = state[:2], state[2:].reshape(2, 3)
        signals = np.array([motion.speed(t), motion.slope(t), gains.bias])
        error = C @ (signals[0] - speed)
        control = gains.proportional * error + estimate @ signals
        acceleration = -axes.pole * speed + axes.gain * (control + motion.load(t))
        return np.concatenate([acceleration, np.outer(gains.adaptation * error, signals).ravel()])

    return slopes


def _integrated(slopes, start, begin: float, end: float, inside) -> Float[np.ndarray, "S n"]:
    """States at the instants inside, and at the end."""
    before = np.nextafter(end, begin)  # a load that jumps at the end has not jumped yet

    def held(t, state):
        return slopes(min(t, before), state)

    if end <= begin:
        return start[None]
    at = np.append(inside, end)
    found = solve_ivp(held, (begin, end), start, "DOP853", at, rtol=ACCURACY, atol=ACCURACY)
    if not found.success:
        raise RuntimeError(f"synchronisation: the integrator stopped: {found.message}")
    return found.y.T
