"""Cancellation of run-out: sinusoids of known frequency, adapted in phase and size.

Adaptive feedforward cancellation (Bodson, Sacks & Khosla 1994; Sidman's subject in the volume of
1990, which has no text of it here). To the control of sample k is added

    sum over h of a_h cos(w_h k) + s_h sin(w_h k),
    a_h += gain e cos(w_h k + phase_h),     s_h += gain e sin(w_h k + phase_h)
with the error e = r - y and the phase of the plant's response at w_h. The adaptation is stable
while the phase is right within 90 degrees; the closer to that, the slower.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from jcontour._arrays import ranked
from jcontour._tracing import is_concrete
from jcontour.controller import Controller, checked_gain
from jcontour.controllers.learning.error_driven import (
    ErrorDriven,
    ErrorDrivenMemory,
    ErrorDrivenPlan,
)
from jcontour.sensors import Sensors


class Waves(NamedTuple):
    """Coefficients of every axis and frequency, and the number of the next sample."""

    cosine: Float[Array, "m h"]
    sine: Float[Array, "m h"]
    sample: Int[Array, ""]


class Canceller(eqx.Module):
    """The adaptation of the sinusoids.

    Args:
        frequency: w of every harmonic [rad per sample].
        phase: of the plant's response at each of them [rad]; one number stands for all.
        gain: of the adaptation.

    Raises:
        ValueError: a frequency is not between zero and pi, there are other phases than one or one
            for each frequency, a phase is not finite, or the gain is negative or not one number.
    """

    frequency: Float[Array, " h"]
    phase: Float[Array, "*h"]
    gain: Float[Array, ""]

    def __init__(
        self,
        frequency: ArrayLike | Sequence[float],
        phase: ArrayLike | Sequence[float],
        gain: ArrayLike | Sequence[float],
    ):
        self.frequency = ranked(frequency, 1)
        self.phase, self.gain = jnp.asarray(phase, float), checked_gain("gain", gain)
        count = self.frequency.size
        if self.frequency.ndim != 1 or self.phase.shape not in ((), (count,)):
            raise ValueError(
                f"phase: needs one number, or one for each of {count} frequencies, "
                f"received shape {self.phase.shape}"
            )
        if self.gain.ndim:
            raise ValueError(f"gain: needs one number, received shape {self.gain.shape}")
        if is_concrete(self.phase) and not np.isfinite(np.asarray(self.phase)).all():
            raise ValueError(f"phase: needs to be finite, received {phase}")
        if is_concrete(self.frequency):
            w = np.asarray(self.frequency)
            if not np.all((w > 0) & (w < np.pi)):
                raise ValueError(
                    f"frequency: needs to be above zero and below pi rad per sample, received {w}"
                )

    def start(self, axes: int) -> Waves:
        """Nothing learned yet."""
        nothing = jnp.zeros((axes, self.frequency.size))
        return Waves(nothing, nothing, jnp.zeros((), int))

    def step(self, memory: Waves, error: Float[Array, " m"]) -> tuple[Waves, Float[Array, " m"]]:
        """Next coefficients, and what is added to the control."""
        turn = self.frequency * memory.sample.astype(error.dtype)
        seen = turn + self.phase
        share = self.gain * error[:, None]
        cosine = memory.cosine + share * jnp.cos(seen)[None]
        sine = memory.sine + share * jnp.sin(seen)[None]
        added = cosine @ jnp.cos(turn) + sine @ jnp.sin(turn)
        return Waves(cosine, sine, memory.sample + 1), added


class RunoutCancelled(ErrorDriven):
    """A controller with sinusoids added to its control, one set for every axis.

    The wrapped controller has as many controls as the sensors have axes.

    >>> from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
    >>> from jcontour.sensors import motors
    >>> cascade = Cascade(CascadeGains(30.0, 55.67, 0.04), motors(1), dt=1e-3)
    >>> cancelled = RunoutCancelled(cascade, motors(1), Canceller(0.1, phase=-0.2, gain=5.0))
    >>> cancelled.preview
    1

    Args:
        controller: the wrapped controller.
        sensors: where the positions stand in the measurement.
        canceller: frequencies, phases and gain.
    """

    controller: Controller
    sensors: Sensors
    canceller: Canceller

    def untaught(self, axes: int) -> Waves:
        """Nothing learned yet."""
        return self.canceller.start(axes)

    def step(
        self, memory: ErrorDrivenMemory, plan: ErrorDrivenPlan, measurement: Any
    ) -> tuple[ErrorDrivenMemory, Float[Array, " p"]]:
        """Control of the wrapped controller, and the sinusoids."""
        waves, added = self.canceller.step(memory.learned, self.error(plan, measurement))
        inner, control = self.controller.step(memory.inner, plan.inner, measurement)
        return ErrorDrivenMemory(waves, inner), control + added
