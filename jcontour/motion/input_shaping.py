"""Input shapers: a reference is replaced by the weighted sum of delayed copies of itself, timed so that a vibration cancels.

    shaped(t) = sum_i a_i r(t - t_i),     t_0 = 0,  sum_i a_i = 1
Behind it a mode s^2 + 2 zeta w s + w^2 is left to vibrate, once the reference has come to rest,
with the share
    V(w, zeta) = exp(-zeta w t_n) | sum_i a_i exp((zeta + j sqrt(1 - zeta^2)) w t_i) |
of what an impulse at t = 0 makes of it, t_n the last of the times. With half a period h = pi / (w
sqrt(1 - zeta^2)) and K = exp(-zeta w h), all at times 0, h, 2 h:
    ZV    [1, K] / (1 + K)                            V = 0
    ZVD   [1, 2 K, K^2] / (1 + K)^2                   V = 0 and dV/dw = 0
    EI    [1 + G, 2 (1 - G) K, (1 + G) K^2] / N       V = `vibration`, in return zero on either
    side: the widest band below it
with G = V (1 + K)^2 / (4 K^2 - V (1 - K)^2) and N = (1 + K)^2 + G (1 - K)^2. Without damping K = 1,
G = V, and
    V_ZV = |cos(pi w' / 2 w)|,   V_ZVD = cos^2(pi w' / 2 w),   V_EI = |(1 - G) + (1 + G) cos(pi w' /
    w)| / 2    for a mode at w'.
Singer & Seering 1990 (ZV, ZVD); Singhose, Seering & Singer 1994 (EI), whose damped form is a fit by
numbers. Here the damped EI is exact at the modelled mode, and its zeros are at modes with the same
decay zeta w.
"""

from functools import reduce

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour.motion.references import Law
from jcontour.tracing import is_concrete


class Shaper(eqx.Module):
    """Impulses: traceable.

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
                f"amplitudes: need as many as times, at least one, received {self.amplitudes.shape} and {self.times.shape}"
            )
        if is_concrete(self.times) and not (
            self.times[0] == 0 and np.all(np.diff(self.times) >= 0) and np.isfinite(self.times[-1])
        ):
            raise ValueError(
                f"times: need to be finite and to ascend from zero, received {self.times}"
            )
        if is_concrete(self.amplitudes) and not abs(np.sum(self.amplitudes) - 1) < 1e-9:
            raise ValueError(f"amplitudes: need to sum to one, received {self.amplitudes}")

    @property
    def duration(self) -> Float[Array, ""]:
        """By how much a motion becomes longer [s]."""
        return self.times[-1]


def zv(frequency, damping=0.0) -> Shaper:
    """Zero vibration: the shortest with positive impulses.

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
    """Zero vibration and derivative: two ZV shapers in a row, flat at the modelled frequency.

    Raises:
        ValueError: as `zv`.
    """
    half, K = _mode(frequency, damping)
    return _at_half_periods(half, jnp.stack([jnp.ones_like(K), 2 * K, K**2]))


def ei(frequency, damping=0.0, vibration=0.05) -> Shaper:
    """Extra-insensitive: as long as ZVD, with `vibration` V left at the modelled frequency. The usual 5 % stay below it for +-20 %.

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
            f"vibration: at a damping of {damping} less than {vibration} is left without a third impulse; use zv"
        )
    return _at_half_periods(half, jnp.stack([1 + G, 2 * (1 - G) * K, (1 + G) * K**2]))


def in_series(*shapers: Shaper) -> Shaper:
    """One after the other, for several modes: the impulses convolved, every one of which cancels what it is for."""

    def after(first: Shaper, second: Shaper) -> Shaper:
        times = (first.times[:, None] + second.times).ravel()
        order = jnp.argsort(times)
        return Shaper(times[order], (first.amplitudes[:, None] * second.amplitudes).ravel()[order])

    return reduce(after, shapers)


def residual_vibration(
    shaper: Shaper, frequency: Float[ArrayLike, "*b"], damping: Float[ArrayLike, "*#b"] = 0.0
) -> Float[Array, "*b"]:
    """V of modes w [rad/s], zeta behind a shaper: the share of its impulse response that is left after the last impulse."""
    w, zeta = (jnp.asarray(value, float)[..., None] for value in (frequency, damping))
    since = shaper.times - shaper.times[-1]
    return jnp.abs(
        jnp.sum(
            shaper.amplitudes * jnp.exp((zeta + 1j * jnp.sqrt(1 - zeta**2)) * w * since), axis=-1
        )
    )


def shaped_law(law: Law, shaper: Shaper) -> Law:
    """A law of time behind a shaper, itself a law: sampled by `references.in_time` it has every impulse at its exact time.

    On a contour the tool stays on the path, and the feed along it is shaped.
    """
    times, amplitudes = np.asarray(shaper.times), np.asarray(shaper.amplitudes)

    def arc(time: Float[np.ndarray, " S"]) -> Float[np.ndarray, " S"]:
        delayed = np.maximum(np.asarray(time)[:, None] - times, 0.0)
        return np.asarray(law(delayed.ravel())).reshape(delayed.shape) @ amplitudes

    return arc


def _mode(frequency, damping) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Half a period of the damped mode [s], and how much it decays in this time."""
    if is_concrete(frequency) and not (np.isfinite(frequency) and float(frequency) > 0):
        raise ValueError(f"frequency: needs to be finite and above zero, received {frequency}")
    if is_concrete(damping) and not 0 <= float(damping) < 1:
        raise ValueError(f"damping: needs to be at least 0 and below 1, received {damping}")
    w, zeta = jnp.asarray(frequency, float), jnp.asarray(damping, float)
    half = jnp.pi / (w * jnp.sqrt(1 - zeta**2))
    return half, jnp.exp(-zeta * w * half)


def _at_half_periods(half: Float[Array, ""], weights: Float[Array, " P"]) -> Shaper:
    return Shaper(half * jnp.arange(weights.size), weights / jnp.sum(weights))
