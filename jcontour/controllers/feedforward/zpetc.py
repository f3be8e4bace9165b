"""Zero phase error tracking (Tomizuka 1987), with the integrator of Smith & Lee.

    G = lambda^d B^a(lambda) B^u(lambda) / A(lambda)
    r(k) = A(lambda) B^u(1/lambda) / (B^a(lambda) B^u(1)^2) y_d(k + d)          (4)

Smith & Lee print B^u in the denominator of (4) for B^a, and k_I q^-d B^u B^u in (5) for
k_I q^-d B^a B^u. Poles and cancellable zeros leave, the phase of the other zeros B^u is cancelled:
y / y_d = |B^u|^2 / B^u(1)^2, without phase. lambda = z^-1.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from numpy.polynomial import polynomial

from jcontour._tracing import is_concrete
from jcontour.controller import Controller, check_axes, check_period, checked_period
from jcontour.controllers.feedforward.preview_filter import PreviewFilter
from jcontour.linear.transfer_functions import (
    TransferFunction,
    polynomial_from_zeros,
    sorted_zeros,
)
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors

RINGING = 0.3  # a zero at z = -0.57 is left in the paper: its inverse would ring


def zero_phase_filter(
    transfer: TransferFunction, ringing: float = RINGING, preview: int | None = None
) -> PreviewFilter:
    """The filter of (4): in front of a closed loop, or of a plant for the control it needs.

    >>> from jcontour.linear.transfer_functions import from_polynomials
    >>> loop = from_polynomials([0.0, 0.5, 0.25], [1.0, -0.25], dt=1e-3)
    >>> ahead = zero_phase_filter(loop)
    >>> ahead.preview, ahead.numerator.round(4).tolist(), ahead.denominator.tolist()
    (2, [0.5, 0.875, -0.25], [1.125])

    Args:
        transfer: G.
        ringing: modulus in z above which a stable zero in the left half plane is not cancelled.
        preview: samples that may be looked ahead; as many as the filter needs when not given.

    Raises:
        ValueError: the preview is shorter than the filter needs, or B^u(1) = 0.
    """
    uncancelled = uncancelled_zeros(transfer, ringing)
    zeros = sorted_zeros(transfer, ringing)
    needed = transfer.delay + uncancelled.size - 1
    if preview is not None and preview < needed:
        raise ValueError(
            f"preview: zero phase tracking needs {needed} samples, {transfer.delay} of delay and "
            f"{needed - transfer.delay} of uncancelled zeros, received {preview}"
        )
    cancelled = transfer.gain * polynomial_from_zeros(zeros.cancellable)
    return PreviewFilter(
        np.convolve(transfer.denominator, uncancelled[::-1]),
        cancelled * np.sum(uncancelled) ** 2,
        needed,
    )


def gain_error(transfer: TransferFunction, frequency, ringing: float = RINGING) -> np.ndarray:
    """Gain |B^u|^2 / B^u(1)^2 - 1 that is left at frequencies [rad/s]; there is no phase.

    >>> from jcontour.linear.transfer_functions import from_polynomials
    >>> loop = from_polynomials([0.0, 0.5, 0.25], [1.0, -0.25], dt=1e-3)
    >>> gain_error(loop, [0.0, 500 * np.pi]).round(3).tolist()
    [0.0, -0.444]

    Raises:
        ValueError: B^u(1) = 0.
    """
    uncancelled = uncancelled_zeros(transfer, ringing)
    points = np.exp(-1j * np.asarray(frequency, float) * transfer.dt)
    return np.abs(polynomial.polyval(points, uncancelled) / np.sum(uncancelled)) ** 2 - 1


def uncancelled_zeros(transfer: TransferFunction, ringing: float) -> Float[np.ndarray, " s"]:
    """B^u, one at lambda = 0."""
    zeros = sorted_zeros(transfer, ringing)
    found = polynomial_from_zeros(np.concatenate([zeros.unstable, zeros.on_circle]))
    if abs(np.sum(found)) <= 1e-9 * np.sum(np.abs(found)):
        raise ValueError("plant: has a zero at z = 1, it does not follow a constant reference")
    return found


class _Plan(NamedTuple):
    """Filtered and desired positions [m]."""

    filtered: Float[Array, "*T m"]
    desired: Float[Array, "*T m"]


class ZeroPhaseTracking(Controller):
    """Position loop behind a zero-phase filter, with an integrator of the tracking error.

        u = k_p (r(k) + (T / T_i) S(k) - y(k)),   S(k) = S(k-1) + y_d(k) - y(k)

    Args:
        ahead: the filter that gives r, of the closed loop y / r.
        gain: k_p, control per m: one number, or one for each axis.
        sensors: where the positions stand in the measurement.
        dt: sample period T [s].
        integral_time: T_i [s]; no integrator when infinite.

    Raises:
        ValueError: the gain, the integral time or `dt` is not above zero.
    """

    laws_not_kept = {"restart": "the filter reads samples before the one at which a run begins"}
    ahead: PreviewFilter
    gain: Float[Array, "*m"]
    integral_time: Float[Array, "*m"]
    sensors: Sensors
    dt: float = eqx.field(static=True)

    def __init__(
        self,
        ahead: PreviewFilter,
        gain: ArrayLike,
        sensors: Sensors,
        dt: float,
        integral_time: ArrayLike = np.inf,
    ):
        for name, value in (("gain", gain), ("integral_time", integral_time)):
            if is_concrete(value) and not np.all(np.asarray(value) > 0):
                raise ValueError(f"{name}: needs to be above zero, received {value}")
        self.ahead, self.sensors, self.dt = ahead, sensors, checked_period(dt)
        self.gain, self.integral_time = (jnp.asarray(x, float) for x in (gain, integral_time))

    @property
    def preview(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """That of the filter [samples]."""
        return self.ahead.preview

    def prepare(self, reference: Reference) -> _Plan:
        """Filtered references.

        Raises:
            ValueError: the reference has another sample period or number of axes, or too little
                preview.
        """
        check_axes(self.sensors.axes, reference)
        check_period(self.dt, reference)
        return _Plan(self.ahead.of(reference), reference.position[: reference.steps])

    def initial_memory(self, reference: Reference) -> Float[Array, " m"]:
        """No error yet [m]."""
        return jnp.zeros(reference.position.shape[1], reference.position.dtype)

    def step(self, memory, plan: _Plan, measurement) -> tuple[Float[Array, " m"], Array]:
        """Next sum of errors, and the control."""
        position = self.sensors.positions(measurement)
        total = memory + plan.desired - position
        wanted = plan.filtered + self.dt / self.integral_time * total
        return total, self.gain * (wanted - position)
