"""What repeats with a known period is learned while it runs, around any controller.

Plug-in repetitive control, Tomizuka, Tsao & Chew (1989). With the period N, the error e and a
correction c, at sample k

    c(k) = sum_i q_i w(k - N + i),      w(j) = c(j) + sum_i l_i e(j + i)
q is a smoothing filter without phase. l is a learning filter: an inverse of the loop, or a gain
with a lead. c is zero until all samples that it needs have been seen. As a plug-in, c is added to
the error that the wrapped controller sees: it reads y - c.

Run-out is cancelled by sinusoids of known frequency, adapted in phase and size. Adaptive
feedforward cancellation (Bodson, Sacks & Khosla 1994; Sidman's subject in the volume of 1990, which
has no text of it here). To the control of sample k is added

    sum over h of a_h cos(w_h k) + s_h sin(w_h k),
    a_h += gain e cos(w_h k + phase_h),     s_h += gain e sin(w_h k + phase_h)
with the error e = r - y and the phase of the plant's response at w_h. The adaptation is stable
while the phase is right within 90 degrees; the closer to that, the slower.
"""

import abc
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Float, Int

from jcontour._arrays import is_concrete, ranked, whole_number
from jcontour.controller import Controller, Wrapper, check_axes, checked_gain
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors

SMOOTH = (0.25, 0.5, 0.25)  # forgets what is faster than a quarter of the sampling frequency


class ErrorDrivenPlan(NamedTuple):
    """Plan of the wrapped controller, and the positions of the reference [m]."""

    inner: Any
    wanted: Float[Array, "*T m"]


class ErrorDrivenMemory(NamedTuple):
    """What has been learned, and the memory of the wrapped controller."""

    learned: Any
    inner: Any


class ErrorDriven(Wrapper):
    """What repetitive control and cancellation of run-out share: both read e = r - y."""

    sensors: eqx.AbstractVar[Sensors]

    @abc.abstractmethod
    def initial_learned(self, axes: int) -> Any:
        """Memory of the learning part before the first sample."""

    def prepare(self, reference: Reference) -> ErrorDrivenPlan:
        check_axes(self.sensors.axes, reference)
        wanted = reference.position[: reference.steps]
        return ErrorDrivenPlan(self.controller.prepare(reference), wanted)

    def initial_memory(self, reference: Reference) -> ErrorDrivenMemory:
        inner = self.controller.initial_memory(reference)
        return ErrorDrivenMemory(self.initial_learned(self.sensors.axes), inner)

    def error(self, plan: ErrorDrivenPlan, measurement: Any) -> Float[Array, " m"]:
        """Position error e of this sample [m]."""
        return plan.wanted - self.sensors.positions(measurement)


class Period(NamedTuple):
    """Corrections and errors of the last samples, in a ring; and the number of the next sample."""

    correction: Float[Array, "R m"]
    error: Float[Array, "R m"]
    sample: Int[Array, ""]


class RepetitiveFilter(eqx.Module):
    """The filters of repetitive control; each is centred and has an odd number of taps.

    Args:
        period: N [samples].
        learning: l, from the latest tap e(j - reach) to the earliest e(j + reach).
        smoothing: q, likewise.
        lead: samples by which l is moved ahead: the delay of the loop.

    Raises:
        ValueError: a filter has an even number of taps, period or lead is not a whole number of
            samples, the lead is negative, or the period is not longer than what the filters look
            ahead.
    """

    learning: Float[Array, " l"]
    smoothing: Float[Array, " q"]
    period: int = eqx.field(static=True)
    lead: int = eqx.field(static=True)

    def __init__(
        self,
        period: int | float,
        learning: ArrayLike | Sequence[float],
        smoothing: ArrayLike | Sequence[float] = SMOOTH,
        lead: int | float = 0,
    ):
        self.learning = ranked(learning, 1)
        self.smoothing = ranked(smoothing, 1)
        self.period, self.lead = whole_number("period", period), whole_number("lead", lead)
        for name, taps in {"learning": self.learning, "smoothing": self.smoothing}.items():
            if taps.ndim != 1 or taps.size % 2 == 0:
                raise ValueError(f"{name}: needs an odd number of taps, received {taps.shape}")
        if period <= self.ahead:
            raise ValueError(
                f"period: needs to be longer than the {self.ahead} samples that the filters look "
                f"ahead, received {period}"
            )

    @property
    def ahead(self) -> int:
        """Samples that the filters look ahead together."""
        return self.learning.size // 2 + self.smoothing.size // 2 + self.lead

    @property
    def behind(self) -> int:
        """Samples that the filters look back together."""
        return self.learning.size // 2 + self.smoothing.size // 2

    def start(self, axes: int) -> Period:
        """Memory before the first sample."""
        nothing = jnp.zeros((self.period + self.behind, axes))
        return Period(nothing, nothing, jnp.zeros((), int))

    def correction(self, memory: Period) -> Float[Array, " m"]:
        """c(k) of the sample that comes next."""
        rings = memory.correction.shape[0]
        q, taps = self.smoothing.size // 2, self.learning.size // 2
        j = memory.sample - self.period + jnp.arange(-q, q + 1)
        learned = j[:, None] + (self.lead + jnp.arange(-taps, taps + 1))[None]
        errors = jnp.einsum("l,qlm->qm", self.learning, memory.error[learned % rings])
        smooth = self.smoothing @ (memory.correction[j % rings] + errors)
        return jnp.where(memory.sample >= self.period + self.behind, smooth, 0.0)

    def updated(
        self, memory: Period, correction: Float[Array, " m"], error: Float[Array, " m"]
    ) -> Period:
        """Memory after a sample."""
        at = memory.sample % memory.correction.shape[0]
        return Period(
            memory.correction.at[at].set(correction),
            memory.error.at[at].set(error),
            memory.sample + 1,
        )


class Repetitive(ErrorDriven):
    """A controller with plug-in repetitive control around it.

    >>> from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
    >>> from jcontour.sensors import motors
    >>> cascade = Cascade(CascadeGains(30.0, 55.67, 0.04), motors(1), dt=1e-3)
    >>> repeated = Repetitive(cascade, motors(1), RepetitiveFilter(period=500, learning=0.3))
    >>> repeated.filter.ahead
    1

    Args:
        controller: the wrapped controller.
        sensors: where the positions stand in the measurement.
        filter: its period and filters.
    """

    controller: Controller
    sensors: Sensors
    filter: RepetitiveFilter

    def initial_learned(self, axes: int) -> Period:
        return self.filter.start(axes)

    def step(
        self, memory: ErrorDrivenMemory, plan: ErrorDrivenPlan, measurement: Any
    ) -> tuple[ErrorDrivenMemory, Float[Array, " p"]]:
        correction = self.filter.correction(memory.learned)
        learned = self.filter.updated(memory.learned, correction, self.error(plan, measurement))
        shifted = moved_positions(measurement, self.sensors, -correction)
        inner, control = self.controller.step(memory.inner, plan.inner, shifted)
        return ErrorDrivenMemory(learned, inner), control


def moved_positions(measurement: Any, sensors: Sensors, shift: Float[Array, " m"]) -> Any:
    """The measurement with other positions [m]; everything else in it stays."""
    flat, shaped = ravel_pytree(measurement)
    return shaped(flat.at[np.array(sensors.position)].add(shift / sensors.scale))


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
        """Memory before the first sample."""
        nothing = jnp.zeros((axes, self.frequency.size))
        return Waves(nothing, nothing, jnp.zeros((), int))

    def step(self, memory: Waves, error: Float[Array, " m"]) -> tuple[Waves, Float[Array, " m"]]:
        turn = self.frequency * memory.sample.astype(error.dtype)
        phase = turn + self.phase
        share = self.gain * error[:, None]
        cosine = memory.cosine + share * jnp.cos(phase)[None]
        sine = memory.sine + share * jnp.sin(phase)[None]
        added = cosine @ jnp.cos(turn) + sine @ jnp.sin(turn)
        return Waves(cosine, sine, memory.sample + 1), added


class RunoutCancelled(ErrorDriven):
    """A controller with sinusoids added to its control, one set for every axis.

    The wrapped controller has as many controls as the sensors have axes.

    Args:
        controller: the wrapped controller.
        sensors: where the positions stand in the measurement.
        canceller: frequencies, phases and gain.
    """

    controller: Controller
    sensors: Sensors
    canceller: Canceller

    def initial_learned(self, axes: int) -> Waves:
        return self.canceller.start(axes)

    def step(
        self, memory: ErrorDrivenMemory, plan: ErrorDrivenPlan, measurement: Any
    ) -> tuple[ErrorDrivenMemory, Float[Array, " p"]]:
        waves, added = self.canceller.step(memory.learned, self.error(plan, measurement))
        inner, control = self.controller.step(memory.inner, plan.inner, measurement)
        return ErrorDrivenMemory(waves, inner), control + added
