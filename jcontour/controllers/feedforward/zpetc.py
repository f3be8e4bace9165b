"""Filters that see the reference ahead of time: zero phase error tracking, and causal inversion.

Zero phase error tracking (Tomizuka 1987), with the integrator of Smith & Lee:

    G = lambda^d B^a(lambda) B^u(lambda) / A(lambda)
    r(k) = A(lambda) B^u(1/lambda) / (B^a(lambda) B^u(1)^2) y_d(k + d)          (4)

Smith & Lee print B^u in the denominator of (4) for B^a, and k_I q^-d B^u B^u in (5) for
k_I q^-d B^a B^u. Poles and cancellable zeros leave, the phase of the other zeros B^u is cancelled:
y / y_d = |B^u|^2 / B^u(1)^2, without phase. lambda = z^-1.

A preview filter gives

    out(k) = [numerator(lambda) / denominator(lambda)] r(k + preview)

Before its first sample the reference was in the steady motion of its start. The filter has been
running since: its answer to that motion is exact, only the rest is filtered.

Causal inversion of the same G looks ahead no further than its delay:

    u(k) = A(lambda) / (B^a(lambda) B^u(1)) y_d(k + d)
Poles and cancellable zeros leave, of the other zeros B^u the steady gain is matched: the output is
y = B^u(lambda) / B^u(1) y_d. Wang & Chen (2006, Yuan's [44]) invert a non-minimum phase arm
causally. Zero phase tracking cancels the phase of B^u by looking further ahead, with the error of
second order in the frequency. Here it is of first order: a lag, constant along a steady motion.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import polynomial

from jcontour._arrays import check_signs, is_concrete
from jcontour.controller import Controller, check_axes, check_period, checked_period, numbers
from jcontour.linear.transfer_functions import TransferFunction, polynomial_from_zeros, sorted_zeros
from jcontour.motion.references import Reference
from jcontour.sensors import Sensors

RINGING = 0.3  # a zero at z = -0.57 is left in the paper: its inverse would ring


class PreviewFilter(eqx.Module):
    """A stable filter, the same for every axis or one for each; traceable in its coefficients.

    Args:
        numerator: (c,) or (m, c), ascending in lambda = z^-1.
        denominator: (d,) or (m, d), ascending; the first coefficient is not zero.
        preview: samples that it looks ahead.

    Raises:
        ValueError: a coefficient is not finite, the filter is not stable, or the preview is
            negative.
    """

    numerator: Float[Array, "*m c"]
    denominator: Float[Array, "*m d"]
    preview: int = eqx.field(static=True)

    def __init__(self, numerator, denominator, preview: int):
        self.numerator = jnp.asarray(numerator, float)
        self.denominator = jnp.asarray(denominator, float)
        self.preview = int(preview)
        if self.preview < 0:
            raise ValueError(f"preview: cannot be negative, received {preview}")
        if is_concrete(self.numerator, self.denominator):
            for row in np.atleast_2d(np.asarray(self.denominator)):
                poles = np.abs(np.roots(row)) if row[0] else np.array([np.inf])
                if not (np.isfinite(row).all() and np.all(poles < 1)):
                    raise ValueError(
                        "denominator: the filter is not stable, its poles in z are "
                        f"{np.round(poles, 6)}"
                    )
            if not np.isfinite(np.asarray(self.numerator)).all():
                raise ValueError("numerator: every coefficient needs to be finite")

    def of(self, reference: Reference) -> Float[Array, "T m"]:
        """Filtered positions of the T control steps.

        Raises:
            ValueError: the reference has fewer preview samples than the filter.
        """
        return self.before_and_of(reference)[self.preview :]

    def before_and_of(self, reference: Reference) -> Float[Array, "both m"]:
        """Filtered positions from `preview` samples before the first control step on.

        Raises:
            ValueError: as `of`.
        """
        if reference.preview < self.preview:
            raise ValueError(
                f"preview: the filter looks {self.preview} samples ahead, "
                f"the reference was made with {reference.preview}"
            )
        samples = reference.position[: reference.steps + self.preview]
        increment = reference.start_increment
        top, below = self._rows(samples.shape[1])
        count = jnp.arange(samples.shape[0], dtype=samples.dtype)[:, None]
        steady = samples[:1] + count * increment[None]
        # Answer to the steady motion start + k increment: H(1) r - H'(1) dr
        start = samples[0]
        # Gain and derivative of a ratio of polynomials at lambda = 1
        values = []
        for rows in (top, below):
            powers = jnp.arange(rows.shape[1], dtype=rows.dtype)
            values += [jnp.sum(rows, axis=1), rows @ powers]
        n, dn, d, dd = values
        gain, slope = n / d, (dn * d - n * dd) / d**2
        out = gain[None] * (start[None] + count * increment[None]) - (slope * increment)[None]
        return out + causal(top, below, samples - steady)

    def _rows(self, axes: int) -> tuple[Float[Array, "m c"], Float[Array, "m d"]]:
        """Numerator and denominator of every axis."""
        polynomials = (self.numerator, self.denominator)
        top, below = (jnp.broadcast_to(one, (axes, one.shape[-1])) for one in polynomials)
        return top, below


def causal(
    numerator: Float[Array, "m c"], denominator: Float[Array, "m d"], samples: Float[Array, "S m"]
) -> Float[Array, "S m"]:
    """Filter from rest, sample by sample in the transposed direct form."""
    order = max(numerator.shape[1], denominator.shape[1], 2)

    def padded(rows: Array) -> Float[Array, "o m"]:
        scaled = rows / denominator[:, :1]
        return jnp.pad(scaled, ((0, 0), (0, order - rows.shape[1]))).T

    b, a = padded(numerator), padded(denominator)

    def step(memory, sample):
        out = b[0] * sample + memory[0]
        later = jnp.concatenate([memory[1:], jnp.zeros_like(memory[:1])])
        return later + b[1:] * sample[None] - a[1:] * out[None], out

    rest = jnp.zeros((order - 1, samples.shape[1]), samples.dtype)
    return jax.lax.scan(step, rest, samples)[1]


def zero_phase_filter(transfer: TransferFunction, ringing: float = RINGING) -> PreviewFilter:
    """The filter of (4): in front of a closed loop, or of a plant for the control it needs.

    >>> from jcontour.linear.transfer_functions import from_polynomials
    >>> loop = from_polynomials([0.0, 0.5, 0.25], [1.0, -0.25], dt=1e-3)
    >>> ahead = zero_phase_filter(loop)
    >>> ahead.preview, ahead.numerator.round(4).tolist(), ahead.denominator.tolist()
    (2, [0.5, 0.875, -0.25], [1.125])

    Args:
        transfer: G.
        ringing: modulus in z above which a stable zero in the left half plane is not cancelled.

    Raises:
        ValueError: B^u(1) = 0.
    """
    uncancelled = uncancelled_zeros(transfer, ringing)
    zeros = sorted_zeros(transfer, ringing)
    cancelled = transfer.gain * polynomial_from_zeros(zeros.cancellable)
    return PreviewFilter(
        np.convolve(transfer.denominator, uncancelled[::-1]),
        cancelled * np.sum(uncancelled) ** 2,
        transfer.delay + uncancelled.size - 1,
    )


def gain_error(transfer: TransferFunction, frequency) -> np.ndarray:
    """Gain |B^u|^2 / B^u(1)^2 - 1 that is left at frequencies [rad/s]; there is no phase.

    >>> from jcontour.linear.transfer_functions import from_polynomials
    >>> loop = from_polynomials([0.0, 0.5, 0.25], [1.0, -0.25], dt=1e-3)
    >>> gain_error(loop, [0.0, 500 * np.pi]).round(3).tolist()
    [0.0, -0.444]

    Raises:
        ValueError: B^u(1) = 0.
    """
    uncancelled = uncancelled_zeros(transfer, RINGING)
    points = np.exp(-1j * np.asarray(frequency, float) * transfer.dt)
    return np.abs(polynomial.polyval(points, uncancelled) / np.sum(uncancelled)) ** 2 - 1


def uncancelled_zeros(transfer: TransferFunction, ringing: float) -> Float[np.ndarray, " s"]:
    """B^u, one at lambda = 0."""
    zeros = sorted_zeros(transfer, ringing)
    polynomial = polynomial_from_zeros(np.concatenate([zeros.unstable, zeros.on_circle]))
    if abs(np.sum(polynomial)) <= 1e-9 * np.sum(np.abs(polynomial)):
        raise ValueError("plant: has a zero at z = 1, it does not follow a constant reference")
    return polynomial


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
    gain: Float[Array, "*m"] = eqx.field(converter=numbers)
    sensors: Sensors
    dt: float = eqx.field(static=True, converter=checked_period)
    integral_time: Float[Array, "*m"] = eqx.field(converter=numbers, default=np.inf)

    def __check_init__(self):
        check_signs(self, positive=("gain",))
        if is_concrete(self.integral_time) and not np.all(self.integral_time > 0):
            raise ValueError(
                f"integral_time: needs to be above zero, received {self.integral_time}"
            )

    @property
    def preview(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.ahead.preview

    def prepare(self, reference: Reference) -> _Plan:
        check_axes(self.sensors.axes, reference)
        check_period(self.dt, reference)
        return _Plan(self.ahead.of(reference), reference.position[: reference.steps])

    def initial_memory(self, reference: Reference) -> Float[Array, " m"]:
        return jnp.zeros(reference.position.shape[1], reference.position.dtype)

    def step(self, memory, plan: _Plan, measurement) -> tuple[Float[Array, " m"], Array]:
        position = self.sensors.positions(measurement)
        total = memory + plan.desired - position
        wanted = plan.filtered + self.dt / self.integral_time * total
        return total, self.gain * (wanted - position)


def causal_filter(transfer: TransferFunction, ringing: float = RINGING) -> PreviewFilter:
    """The filter from y_d to u.

    >>> from jcontour.linear.transfer_functions import from_polynomials
    >>> plant = from_polynomials([0.0, 0.5, 1.0], [1.0, -0.25], dt=1e-3)
    >>> ahead = causal_filter(plant)
    >>> ahead.preview, ahead.numerator.round(4).tolist(), ahead.denominator.tolist()
    (1, [1.0, -0.25], [1.5])

    Args:
        transfer: G.
        ringing: modulus in z above which a stable zero in the left half plane is not cancelled.

    Raises:
        ValueError: B^u(1) = 0.
    """
    cancelled = polynomial_from_zeros(sorted_zeros(transfer, ringing).cancellable)
    gain = transfer.gain * float(np.sum(uncancelled_zeros(transfer, ringing)))
    return PreviewFilter(transfer.denominator, gain * cancelled, transfer.delay)
