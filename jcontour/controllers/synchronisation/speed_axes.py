"""Axes whose speed follows the control with one lag, as adaptive synchronisation sees them.

w' = -a w + b (u + d)                          Tomizuka et al. (1990), eq. 1
w(k+1) = a_d w(k) + b_d (u(k) + d),   a_d = exp(-a T),  b_d = (b / a) (1 - a_d)        eq. 10
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class SpeedAxes(NamedTuple):
    """Poles and gains of the axes.

    >>> axes = speed_axes(pole=10.0, gain=[50.0, 40.0])
    >>> axes.feedforward().tolist()
    [[0.2, 0.02, 0.0], [0.25, 0.025, 0.0]]

    Attributes:
        pole: a [rad/s].
        gain: b [speed per second and unit of control].
    """

    pole: Float[np.ndarray, " m"]
    gain: Float[np.ndarray, " m"]

    def sampled(self, dt: float) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """(a_d, b_d) under zero-order hold."""
        lost = -np.expm1(-self.pole * dt)
        return 1 - lost, self.gain / self.pole * lost

    def feedforward(self, dt: float | None = None) -> Float[np.ndarray, "m 3"]:
        """Estimates that fit the axes without load.

        Continuous: (a/b, 1/b, 0) for (w_d, w_d', v_c); sampled: (-a_d/b_d, 1/b_d, 0) for (w_d(k),
        w_d(k+1), v_c). Appendix A prints -1/b_d.
        """
        none = np.zeros_like(self.pole)
        if dt is None:
            return np.stack([self.pole / self.gain, 1 / self.gain, none], axis=-1)
        a_d, b_d = self.sampled(dt)
        return np.stack([-a_d / b_d, 1 / b_d, none], axis=-1)


def speed_axes(pole, gain) -> SpeedAxes:
    """Axes with these poles [rad/s] and gains; one number stands for all axes.

    Raises:
        ValueError: a number is not finite or not above zero.
    """
    pole, gain = np.broadcast_arrays(np.atleast_1d(pole), np.atleast_1d(gain))
    for name, values in {"pole": pole, "gain": gain}.items():
        if not np.all(np.isfinite(values) & (values > 0)):
            raise ValueError(f"{name}: needs to be above zero, received {values}")
    return SpeedAxes(np.array(pole, float), np.array(gain, float))
