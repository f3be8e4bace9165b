"""Type-1 servos side by side: a gain, a pole and an integrator for each axis.

    v' = -p v + k (u + d),   y' = v
A DC motor under a current amplifier is one: Tomizuka et al. (1990), eq. 1, where p is a and k is b.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import block_diag

from jcontour._tracing import is_concrete
from jcontour.linear.plant import LinearPlant, Pattern


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
    for name, value in {"dt": dt, "gain": gain, "pole": pole}.items():
        if is_concrete(value) and not np.all(np.isfinite(value) & (np.asarray(value) > 0)):
            raise ValueError(f"{name}: needs to be above zero, received {value}")
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
