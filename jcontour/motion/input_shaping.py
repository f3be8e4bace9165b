"""Input shapers: weighted sums of delayed copies of a reference, timed so that a vibration cancels.

    shaped(t) = sum_i a_i r(t - t_i),     t_0 = 0,  sum_i a_i = 1
Behind a shaper a mode s^2 + 2 zeta w s + w^2 vibrates on, once the reference has come to rest. Its
share of what an impulse at t = 0 makes of it is, with t_n the last of the times,

    V(w, zeta) = exp(-zeta w t_n) | sum_i a_i exp((zeta + j sqrt(1 - zeta^2)) w t_i) |
With half a period h = pi / (w sqrt(1 - zeta^2)) and K = exp(-zeta w h), all at times 0, h, 2 h:

    ZV    [1, K] / (1 + K)                            V = 0
    ZVD   [1, 2 K, K^2] / (1 + K)^2                   V = 0 and dV/dw = 0
    EI    [1 + G, 2 (1 - G) K, (1 + G) K^2] / N       V = `vibration`
EI has zeros on either side of the mode in return, and the widest band below `vibration`. Here
G = V (1 + K)^2 / (4 K^2 - V (1 - K)^2) and N = (1 + K)^2 + G (1 - K)^2. Without damping K = 1,
G = V, and for a mode at w'

    V_ZV  = |cos(pi w' / 2 w)|
    V_ZVD = cos^2(pi w' / 2 w)
    V_EI  = |(1 - G) + (1 + G) cos(pi w' / w)| / 2
Singer & Seering 1990 (ZV, ZVD); Singhose, Seering & Singer 1994 (EI), whose damped form is a fit by
numbers. Here the damped EI is exact at the modelled mode, and its zeros are at modes with the same
decay zeta w.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import check_above_zero, is_concrete


class Shaper(eqx.Module):
    """Impulses of a shaper; traceable.

    Args:
        times: t_i [s], ascending from zero.
        amplitudes: a_i, their sum one.

    Raises:
        ValueError: different numbers of times and amplitudes, times that do not begin at zero and
            ascend, or another sum.
    """

    times: Float[Array, " P"] = eqx.field(converter=jnp.asarray)
    amplitudes: Float[Array, " P"] = eqx.field(converter=jnp.asarray)

    def __check_init__(self):
        if self.times.ndim != 1 or self.times.shape != self.amplitudes.shape or not self.times.size:
            raise ValueError(
                "amplitudes: need as many as times, at least one, "
                f"received {self.amplitudes.shape} and {self.times.shape}"
            )
        if is_concrete(self.times):
            times = np.asarray(self.times)
            ascending = times[0] == 0 and np.all(np.diff(times) >= 0)
            if not (ascending and np.isfinite(times[-1])):
                raise ValueError(
                    f"times: need to be finite and to ascend from zero, received {self.times}"
                )
        if is_concrete(self.amplitudes) and not abs(np.sum(self.amplitudes) - 1) < 1e-9:
            raise ValueError(f"amplitudes: need to sum to one, received {self.amplitudes}")


def zv(frequency, damping=0.0) -> Shaper:
    """Zero-vibration shaper: the shortest with positive impulses.

    Args:
        frequency: w, undamped [rad/s].
        damping: zeta.

    Raises:
        ValueError: the frequency is not finite and above zero, or the damping not at least zero and
            below one.
    """
    half, K = _mode(frequency, damping)
    return _at_half_periods(half, jnp.stack([jnp.ones_like(K), K]))


def zvd(frequency, damping=0.0) -> Shaper:
    """Zero-vibration-and-derivative shaper: two ZV shapers in a row.

    Its vibration is flat at the modelled frequency.

    Raises:
        ValueError: as `zv`.
    """
    half, K = _mode(frequency, damping)
    return _at_half_periods(half, jnp.stack([jnp.ones_like(K), 2 * K, K**2]))


def ei(frequency, damping=0.0, vibration=0.05) -> Shaper:
    """Extra-insensitive shaper: as long as ZVD, with `vibration` V left at the modelled frequency.

    With the usual 5 %, the vibration stays below it for frequencies within 20 %.

    Raises:
        ValueError: as `zv`; or the vibration is not above zero and below one, or too much for this
            damping.
    """
    if is_concrete(vibration) and not 0 < float(vibration) < 1:
        raise ValueError(f"vibration: needs to be between 0 and 1, received {vibration}")
    half, K = _mode(frequency, damping)
    G = vibration * (1 + K) ** 2 / (4 * K**2 - vibration * (1 - K) ** 2)
    if is_concrete(G) and not 0 < float(G) < 1:
        raise ValueError(
            f"vibration: at a damping of {damping} less than {vibration} is left "
            "without a third impulse; use zv"
        )
    return _at_half_periods(half, jnp.stack([1 + G, 2 * (1 - G) * K, (1 + G) * K**2]))


def _mode(frequency, damping) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Half a period of the damped mode [s], and its decay factor in this time."""
    check_above_zero(frequency=frequency)
    if is_concrete(damping) and not 0 <= float(damping) < 1:
        raise ValueError(f"damping: needs to be at least 0 and below 1, received {damping}")
    w, zeta = jnp.asarray(frequency, float), jnp.asarray(damping, float)
    half = jnp.pi / (w * jnp.sqrt(1 - zeta**2))
    return half, jnp.exp(-zeta * w * half)


def _at_half_periods(half: Float[Array, ""], weights: Float[Array, " P"]) -> Shaper:
    return Shaper(half * jnp.arange(weights.size, dtype=half.dtype), weights / jnp.sum(weights))
