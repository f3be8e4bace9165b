"""Axes as engineers write them down, and the sampled machine that they make.

    control is a speed       K exp(-L s) / (s (T s + 1))          K [m/s per unit of control]
    control is a position    K exp(-L s) / (T s + 1)              K [m per unit of control]
    control is a force       K exp(-L s) / (M s^2 + F s)          K [N per unit of control]
A resonance of frequency w and damping z is a factor w^2 / (s^2 + 2 z w s + w^2). The sampled
machine is exact under a control that is held over each sample: of a delay L = (d + g) dt, 0 <= g <
1, the old control acts over the first g dt of a sample,

    x(k+1) = A(dt) x(k) + A((1-g) dt) B(g dt) u(k-d-1) + B((1-g) dt) u(k-d)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.linalg import block_diag, expm

from jcontour.linear.plant import LinearPlant

WHOLE = 1e-9  # of a sample: a delay this close to whole samples is whole


@dataclass(frozen=True)
class ContinuousAxis:
    """One axis in continuous time, dx/dt = A x + B u(t - delay), y = C x."""

    # A, B, C: matrices; y is a position [m]
    A: Float[np.ndarray, "n n"]
    B: Float[np.ndarray, "n 1"]
    C: Float[np.ndarray, "1 n"]
    delay: float = 0.0  # L [s]

    def response(self, frequency: Float[np.ndarray, " F"]) -> Complex[np.ndarray, " F"]:
        """Complex transfer from the control to the position, over frequency [rad/s]."""
        identity = np.eye(len(self.A))
        values = [
            (self.C @ np.linalg.solve(1j * w * identity - self.A, self.B)).item() for w in frequency
        ]
        return np.array(values) * np.exp(-1j * frequency * self.delay)


def speed_axis(gain: float, time_constant: float = 0.0, delay: float = 0.0) -> ContinuousAxis:
    """Axis whose drive takes a speed: K exp(-L s) / (s (T s + 1)).

    >>> axis = speed_axis(gain=1.0, time_constant=0.02)
    >>> abs(axis.response(np.array([50.0])))[0].round(6)  # 1 / (50 sqrt(2))
    np.float64(0.014142)

    Args:
        gain: K [m/s per unit of control].
        time_constant: T [s]; none when zero.
        delay: L [s].

    Raises:
        ValueError: a number is not finite or negative, or the gain is zero.
    """
    _check(gain=gain, time_constant=time_constant, delay=delay)
    if time_constant == 0:
        return ContinuousAxis(np.zeros((1, 1)), np.array([[gain]]), np.eye(1), delay)
    pole = 1 / time_constant
    A = np.array([[0.0, 1.0], [0.0, -pole]])
    return ContinuousAxis(A, np.array([[0.0], [gain * pole]]), np.eye(1, 2), delay)


def position_axis(gain: float, time_constant: float, delay: float = 0.0) -> ContinuousAxis:
    """Axis whose drive closes its own position loop: K exp(-L s) / (T s + 1).

    Raises:
        ValueError: as `speed_axis`, or the time constant is zero.
    """
    _check(gain=gain, time_constant=time_constant, delay=delay)
    if time_constant == 0:
        raise ValueError("time_constant: a position drive needs one above zero")
    A = np.array([[-1 / time_constant]])
    return ContinuousAxis(A, np.array([[gain / time_constant]]), np.eye(1), delay)


def force_axis(
    gain: float, mass: float, viscous: float = 0.0, delay: float = 0.0
) -> ContinuousAxis:
    """Axis whose drive takes a force or a current: K exp(-L s) / (M s^2 + F s).

    Args:
        gain: K [N per unit of control].
        mass: M [kg].
        viscous: F [N s/m].
        delay: L [s].

    Raises:
        ValueError: as `speed_axis`, or the mass is zero.
    """
    _check(gain=gain, mass=mass, viscous=viscous, delay=delay)
    if mass == 0:
        raise ValueError("mass: needs to be above zero")
    A = np.array([[0.0, 1.0], [0.0, -viscous / mass]])
    return ContinuousAxis(A, np.array([[0.0], [gain / mass]]), np.eye(1, 2), delay)


def with_resonance(axis: ContinuousAxis, frequency: float, damping: float) -> ContinuousAxis:
    """The axis behind w^2 / (s^2 + 2 z w s + w^2), as of a tool on a spring.

    Args:
        axis: without it.
        frequency: w [rad/s].
        damping: z.

    Raises:
        ValueError: the frequency is not above zero, or the damping is not above zero: the mode
            would never die out.
    """
    _check(frequency=frequency, damping=damping)
    if frequency == 0 or damping == 0:
        raise ValueError("resonance: needs a frequency and a damping above zero")
    n = len(axis.A)
    A = np.zeros((n + 2, n + 2))
    A[:n, :n] = axis.A
    A[n, n + 1] = 1.0
    A[n + 1, :n] = frequency**2 * axis.C[0]
    A[n + 1, n:] = -(frequency**2), -2 * damping * frequency
    B = np.concatenate([axis.B, np.zeros((2, 1))])
    return ContinuousAxis(A, B, np.eye(1, n + 2, n), axis.delay)


def sampled_machine(axes: Sequence[ContinuousAxis], dt: float) -> tuple[LinearPlant, int]:
    """Machine of several axes under a held control, and the whole samples of delay beside it.

    The delay that all axes share, in whole samples, is left out of the plant and returned; the rest
    is in its states.

    Raises:
        ValueError: there is no axis, or `dt` is not above zero.
    """
    if not axes:
        raise ValueError("axes: needs one at least")
    _check(dt=dt)
    if dt == 0:
        raise ValueError("dt: needs to be above zero")
    late = [_samples(axis, dt) for axis in axes]
    shared = min(whole for whole, _ in late)
    parts = [
        _sampled(axis, dt, whole - shared, part)
        for axis, (whole, part) in zip(axes, late, strict=True)
    ]
    A, B, C = (block_diag(*matrices) for matrices in zip(*parts, strict=True))
    return LinearPlant(A, B, C, dt), shared


def sampled_axis(
    axis: ContinuousAxis, dt: float
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n 1"], Float[np.ndarray, "1 n"], int]:
    """A, B, C of one axis under a held control, and the whole samples of delay beside it."""
    whole, part = _samples(axis, dt)
    return *_sampled(axis, dt, 0, part), whole


def _samples(axis: ContinuousAxis, dt: float) -> tuple[int, float]:
    """Delay in whole samples, and the part of one."""
    late = axis.delay / dt
    whole = int(np.floor(late + WHOLE))
    return whole, max(late - whole, 0.0)


def _sampled(axis: ContinuousAxis, dt: float, whole: int, part: float) -> tuple:
    """A, B and C of one axis with its own delay; its state ends with the controls still to act."""
    part = 0.0 if part < WHOLE else part
    n, line = len(axis.A), whole + (part > 0)
    over, first = _held(axis, (1 - part) * dt), _held(axis, part * dt)
    A, B = np.zeros((n + line, n + line)), np.zeros((n + line, 1))
    A[:n, :n] = _held(axis, dt)[0]
    now, before = over[1], over[0] @ first[1]
    for back, column in ((whole, now), (whole + 1, before)):  # u(k - back)
        if back == 0:
            B[:n] += column
        elif back <= line:
            A[:n, n + back - 1 : n + back] += column
    if line:
        B[n] = 1.0
        A[n + 1 :, n : n + line - 1] = np.eye(line - 1)
    return A, B, np.concatenate([axis.C, np.zeros((1, line))], axis=1)


def _held(axis: ContinuousAxis, time: float) -> tuple[np.ndarray, np.ndarray]:
    """A and B over a time [s] in which the control is held."""
    n = len(axis.A)
    both = np.zeros((n + 1, n + 1))
    both[:n, :n], both[:n, n:] = axis.A, axis.B
    discrete = expm(both * time)
    return discrete[:n, :n], discrete[:n, n:]


def _check(**values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and value >= 0):
            raise ValueError(f"{name}: needs to be finite and at least zero, received {value}")
        if name == "gain" and value == 0:
            raise ValueError("gain: needs to be above zero")
