"""Linear machines of the papers.

The X-Y table of a Bridgeport Discovery 300 machining centre (McNab & Tsao, section 4).

Velocity commands in, positions [m] out, 2 kHz. X has three states, Y five; nothing couples the
axes.

A linear motor behind a current loop has the zero of Alter & Tsao's drive:

    y' = v,   v' = a - c v,   a' = p (u - a):   P(s) = p / (s (s + c) (s + p))

u is the commanded acceleration. Sampled at 0.5 ms, p = 1161 rad/s puts the unstable zero of their
Table 1 at lambda = -0.3075. It is not the authors' motor, of which they print only this zero.

Type-1 servos stand side by side, a gain, a pole and an integrator for each axis:

    v' = -p v + k (u + d),   y' = v
A DC motor under a current amplifier is one: Tomizuka et al. (1990), eq. 1, where p is a and k is b.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import block_diag

from jcontour._arrays import check_above_zero
from jcontour.linear.plant import LinearPlant, Pattern
from jcontour.linear.transfer_functions import transfer_function
from jcontour.linear.transformations import zoh

SAMPLE_PERIOD = 0.5e-3  # [s] the paper's 2 kHz
ENCODER_RESOLUTION = 0.8e-6  # [m] per count, the paper's encoders


def bridgeport() -> LinearPlant:
    """The paper's matrices, with two lost minus signs restored.

    The two are A[5, 5] = -0.0227 and A[6, 7] = -4.2149. As printed, Y has eigenvalues 3.59 and
    -1.97. This is the only pair of signs that gives one integrator and an otherwise stable axis;
    the ramp gains of both axes then agree to 1.2 %. Lengths are metres. Both axes have a zero
    outside the unit circle (-13.4, -17.8). The integrators sit at 0.999963 (X) and 1.000041 (Y)
    because the paper prints four decimals. An error then depends on where the part lies:
    `exact_bridgeport` is the table to work with.

    >>> table = bridgeport()
    >>> table.states, table.inputs, table.axes, table.dt
    (8, 2, 2, 0.0005)
    """
    A = np.zeros((8, 8))
    A[:3, :3] = [[-0.2916, 0.2755, -0.8029], [-0.8890, 1.6565, -0.8540], [0.0, 1.0343, 0.3324]]
    A[3:, 3:] = [
        [0.5109, 0.5102, 1.1644, 0.9037, -0.9856],
        [-0.7566, 0.7378, 0.7638, 0.9284, -1.5212],
        [0.0, 0.0344, -0.0227, 0.9665, -0.2304],
        [0.0, 0.0, 1.6801, 2.1797, -4.2149],
        [0.0, 0.0, 0.0, 0.9843, -0.6750],
    ]
    B = np.zeros((8, 2))
    B[:3, 0] = [-0.0379e-5, 0.5879e-5, 0.0402e-5]
    B[3:, 1] = [0.2101e-5, 0.2655e-5, 0.1732e-5, 0.6884e-5, 0.0332e-5]
    C = np.zeros((2, 8))
    C[0, 2] = C[1, 7] = 1.0
    return LinearPlant(A, B, C, SAMPLE_PERIOD)


def exact_bridgeport() -> LinearPlant:
    """The table with both integrators at exactly 1, so that no error depends on where a part lies.

    Of each axis one entry moves within the rounding of its fourth printed decimal, to the root of
    det(A - I), which is linear in it. No zero of A is filled. The other poles move by 2e-5.
    """
    printed = bridgeport()
    A = np.array(printed.A)
    A[0, 1] = 0.2754560202050089  # printed 0.2755
    A[5, 5] = -0.022715354721554528  # printed 0.0227, its sign restored
    return LinearPlant(A, printed.B, printed.C, printed.dt)


SLOWEST, FASTEST = 0.05, 50.0  # p dt between which the zero is looked for
PERIOD = 5e-4  # [s] of the paper
ZERO = -0.3075  # of the paper, in lambda


def linear_motor_drive(
    bandwidth: float | None = None, drag: float = 0.0, dt: float = PERIOD
) -> LinearPlant:
    """The drive, sampled exactly: state [y, v, a] in m, m/s, m/s^2.

    >>> from jcontour.linear.transfer_functions import sorted_zeros
    >>> zeros = sorted_zeros(transfer_function(linear_motor_drive()))
    >>> zeros.unstable.real.round(6).tolist(), zeros.cancellable.real.round(3).tolist()
    ([-0.3075], [-4.346])

    Args:
        bandwidth: p of the current loop [rad/s]; the one with the paper's zero when not given.
        drag: c [1/s].
        dt: sample period [s].

    Raises:
        ValueError: a number is not finite, or not above zero (the drag: below zero).
    """
    if bandwidth is None:
        bandwidth = bandwidth_of_zero(ZERO, drag, dt)
    check_above_zero(bandwidth=bandwidth, dt=dt)
    if not (np.isfinite(drag) and drag >= 0):
        raise ValueError(f"drag: needs to be finite and at least zero, received {drag}")
    # in units of a sample all entries are of order one; in SI units expm loses six digits
    p, c = bandwidth * dt, drag * dt
    A, B = zoh([[0.0, 1.0, 0.0], [0.0, -c, 1.0], [0.0, 0.0, -p]], [[0.0], [0.0], [p]], 1.0)
    units = np.array([1.0, 1 / dt, 1 / dt**2])
    A = np.asarray(A) * (units[:, None] / units)
    B = np.asarray(B) * units[:, None] * dt**2
    return LinearPlant(A, B, [[1.0, 0.0, 0.0]], dt)


def bandwidth_of_zero(zero: float, drag: float = 0.0, dt: float = PERIOD) -> float:
    """Bandwidth p [rad/s] that puts the drive's unstable zero at `zero` in lambda.

    Raises:
        ValueError: no bandwidth does.
    """
    from scipy.optimize import brentq  # loaded with the door of the plants otherwise

    def off(p: float) -> float:
        zeros = transfer_function(linear_motor_drive(p / dt, drag, dt)).zeros
        return float(np.real(zeros[0])) - zero

    if off(SLOWEST) * off(FASTEST) > 0:
        raise ValueError(f"zero: no bandwidth puts it at {zero}")
    found = brentq(off, SLOWEST, FASTEST, xtol=1e-15, full_output=False)
    return float(np.asarray(found)) / dt


def servo_axes(gain: Any, pole: Any, dt: float) -> LinearPlant:
    """Servos k / (s (s + p)) under exact zero-order hold, with the state (y_0, v_0, y_1, v_1, ...).

        v(k+1) = e v + k (1 - e)/p u,   y(k+1) = y + (1 - e)/p v + k (x - 1 + e)/p^2 u
    with x = p dt, e = exp(-x).

    >>> plant = servo_axes(gain=[50.0, 40.0], pole=[10.0, 12.0], dt=2e-3)
    >>> plant.states, plant.axes
    (4, 2)

    Args:
        gain: k of every axis (m,) [m/s^2 per unit of control].
        pole: p of every axis (m,) [rad/s]; one number stands for all.
        dt: sample period [s].

    Raises:
        ValueError: a number is not above zero, or the shapes do not fit.
    """
    check_above_zero(dt=dt, gain=gain, pole=pole)
    gain, pole = jnp.asarray(gain, float), jnp.asarray(pole, float)
    if jnp.ndim(gain) != 1 or jnp.shape(pole) not in ((), gain.shape):
        raise ValueError(
            "gain, pole: need one number for each axis, "
            f"received the shapes {gain.shape} and {jnp.shape(pole)}"
        )
    A, B = _sampled(gain, jnp.broadcast_to(pole, gain.shape), dt)
    C = np.kron(np.eye(gain.size), [[1.0, 0.0]])
    return LinearPlant(A, B, C, dt, _pattern(gain.size))


@jax.jit  # one program where it is called outside of one
def _sampled(gain, pole, dt):
    lost = -jnp.expm1(-pole * dt)  # 1 - e
    moved, held = lost / pole, gain * (pole * dt - lost) / pole**2
    blocks_A = [jnp.array([[1.0, m], [0.0, 1 - x]]) for m, x in zip(moved, lost, strict=True)]
    blocks_B = [jnp.array([[h], [k * m]]) for h, k, m in zip(held, gain, moved, strict=True)]
    return block_diag(*blocks_A), block_diag(*blocks_B)


def _pattern(axes: int) -> Pattern:
    """Non-zero pattern, the same for traced numbers."""
    each = np.eye(axes)
    A = np.kron(each, [[1, 1], [0, 1]])
    return Pattern.of(A, np.kron(each, [[1], [1]]), np.kron(each, [[1, 0]]))
