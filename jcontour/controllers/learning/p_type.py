"""P-type iterative learning control (Arimoto, Kawamura & Miyazaki 1984), with a Q filter.

    c_{j+1} = Q [c_j + gain e_j(k + lead)],     Q = ((q + 2 + 1/q) / 4)^n
Q has no phase: its response is cos(w/2)^(2n). It forgets what is too fast to be learned. With the
response T of the positions to the correction, the laps converge, and every lap is better than the
last in the RMS of the correction's distance from its limit, where for every frequency

    |Q (1 - gain exp(jw lead) T)| < 1.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour.controller import checked_gain
from jcontour.controllers.learning.laps import LearningLaw


class PType(LearningLaw):
    """P-type law with a lead and a smoothing filter.

    >>> law = PType(gain=0.5, lead=1, smoothing=1)
    >>> law.update(jnp.zeros((4, 1)), jnp.array([[0.0], [0.0], [2.0], [0.0]]))[:, 0].tolist()
    [0.25, 0.5, 0.25, 0.0]

    Args:
        gain: part of the error that is taken over in a lap.
        lead: samples by which the error is read ahead: the delay of the loop.
        smoothing: n, how often the filter (1/4, 1/2, 1/4) is passed; zero leaves it out.

    Raises:
        ValueError: the gain is negative or not finite, or the lead or the smoothing is negative.
    """

    gain: Float[Array, ""]
    lead: int = eqx.field(static=True)
    smoothing: int = eqx.field(static=True)

    def __init__(self, gain: ArrayLike, lead: int = 0, smoothing: int = 0):
        for name, value in {"lead": lead, "smoothing": smoothing}.items():
            if value != int(value) or value < 0:
                raise ValueError(f"{name}: needs a whole number of at least zero, received {value}")
        self.gain = checked_gain("gain", gain)
        self.lead, self.smoothing = int(lead), int(smoothing)

    def update(
        self, correction: Float[Array, "T m"], error: Float[Array, "T m"]
    ) -> Float[Array, "T m"]:
        """Q [c + gain e(k + lead)]; beyond the end of the lap the error is that of its last sample.

        Raises:
            ValueError: the lead is longer than the lap.
        """
        if self.lead >= error.shape[0]:
            raise ValueError(
                f"lead: {self.lead} samples are more than the lap of {error.shape[0]} has"
            )
        beyond = jnp.repeat(error[-1:], self.lead, axis=0)
        ahead = jnp.concatenate([error[self.lead :], beyond])
        return smoothed(correction + self.gain * ahead, self.smoothing)


def smoothed(signal: Float[Array, "T m"], times: int) -> Float[Array, "T m"]:
    """The signal after (1/4, 1/2, 1/4), passed so often; its ends are held."""
    if times == 0:
        return signal

    def once(x, _):
        held = jnp.concatenate([x[:1], x, x[-1:]])
        return (held[:-2] + 2 * x + held[2:]) / 4, None

    return jax.lax.scan(once, signal, length=times)[0]


def smoothing_of(bandwidth: float, dt: float) -> int:
    """How often to pass the filter for half of the amplitude at a frequency.

        n = ln(1/2) / (2 ln cos(w T / 2))

    >>> smoothing_of(2 * np.pi * 50, 1e-3)
    28

    Args:
        bandwidth: w [rad/s].
        dt: sample period T [s].

    Raises:
        ValueError: the frequency is not above zero and below the Nyquist frequency.
    """
    if not 0 < bandwidth < np.pi / dt:
        raise ValueError(
            f"bandwidth: needs to be above zero and below {np.pi / dt:.4g} rad/s, "
            f"received {bandwidth}"
        )
    return max(1, round(np.log(0.5) / (2 * np.log(np.cos(bandwidth * dt / 2)))))
