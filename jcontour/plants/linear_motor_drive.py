"""A linear motor behind a current loop, an example with the zero of Alter & Tsao's drive.

    y' = v,   v' = a - c v,   a' = p (u - a):   P(s) = p / (s (s + c) (s + p))

u is the commanded acceleration. Sampled at 0.5 ms, p = 1161 rad/s puts the unstable zero of their
Table 1 at lambda = -0.3075. It is not the authors' motor, of which they print only this zero.
"""

import numpy as np

from jcontour.linear.plant import LinearPlant
from jcontour.linear.transfer_functions import transfer_function
from jcontour.linear.transformations import zoh

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
    for name, value in (("bandwidth", bandwidth), ("dt", dt)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name}: needs to be finite and above zero, received {value}")
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
