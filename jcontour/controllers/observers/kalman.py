"""State observers around any state-feedback controller, for machines that measure positions only.

With innovation v = y - C xh and steady-state gain L:

    xf = xh + L v,    xh(k+1) = A xf + B u.
The filter form feeds xf to the controller: it needs the current measurement in time. The predictor
form feeds xh and does not need it. The offset-free form estimates a constant disturbance d of the
controls beside the state, and cancels it; `IntegralLQG` has an integral instead.
"""

import abc
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jcontour._arrays import is_concrete
from jcontour.controller import Controller, Wrapper, check_limit, check_period
from jcontour.linear.plant import LinearPlant, check_stable
from jcontour.linear.small_matrices import small_solve
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare, dare
from jcontour.sensors import row

Deviation = ArrayLike | Sequence[float]  # one for all, or one for each channel


def _array(value: ArrayLike | None) -> Array | None:
    return None if value is None else jnp.asarray(value)


class ObserverMemory(NamedTuple):
    """The predicted state xh, and the memory of the wrapped controller."""

    estimate: Float[Array, " n"] | Float[np.ndarray, " n"]  # NumPy's on the host
    inner: Any


def corrected(estimate: Any, measurement: Any, gain: Any, measured: Any) -> Any:
    """Estimate that includes the measurement: xf = xh + L (y - C xh), in JAX or in NumPy."""
    return estimate + gain @ (measurement - measured @ estimate)


class _Observer(Wrapper):
    """Common part of the filter and the predictor form.

    Args:
        controller: fed the estimate.
        model: model of the machine; its output is the tool.
        gain: filter gain L (n, q).
        start: first estimate; from the reference when not given.
        measured: C (q, n) of the measurement; the model's when not given.

    Raises:
        ValueError: the gain has the wrong shape, or A - A L C has an eigenvalue that is not inside
            the unit circle.
    """

    controller: Controller
    model: LinearPlant
    gain: Float[Array, "n q"] = eqx.field(converter=jnp.asarray)
    start: Float[Array, " n"] | None = eqx.field(converter=_array, default=None)
    measured: Float[Array, "q n"] | None = eqx.field(converter=_array, default=None)

    def __check_init__(self):
        check_gain(self.model.A, self._C, self.gain)

    @property
    def _C(self) -> Float[Array, "q n"]:
        return self.model.C if self.measured is None else self.measured

    def initial_memory(self, reference: Reference) -> ObserverMemory:
        """The estimate starts where the reference says the run begins."""
        check_period(self.model.dt, reference)
        start = self.start
        if start is None:
            start = self.model.initial_state(reference.position[0], reference.start_increment)
        return ObserverMemory(start, self.controller.initial_memory(reference))

    def _update(self, memory: ObserverMemory, measurement: Any) -> Float[Array, " n"]:
        estimate: Array = corrected(memory.estimate, row(measurement), self.gain, self._C)
        return estimate


class FilterObserver(_Observer):
    """A controller fed the estimate that includes the current measurement.

    >>> from jcontour.controllers.lq.preview_lq import PreviewLQ
    >>> from jcontour.plants.linear_machines import bridgeport
    >>> table = bridgeport()
    >>> gain = kalman_gain(table, control_noise=1.0, measurement_noise=1e-6)
    >>> FilterObserver(PreviewLQ(table, 1e8, 1e-2, 10), table, gain).gain.shape
    (8, 2)
    """

    def step(
        self, memory: ObserverMemory, plan: Any, measurement: Any
    ) -> tuple[ObserverMemory, Float[Array, " p"]]:
        filtered = self._update(memory, measurement)
        inner, control = self.controller.step(memory.inner, plan, filtered)
        return ObserverMemory(self.model.step(filtered, control), inner), control


class PredictorObserver(_Observer):
    """A controller fed the prediction: its control is ready when the sample is taken."""

    def step(
        self, memory: ObserverMemory, plan: Any, measurement: Any
    ) -> tuple[ObserverMemory, Float[Array, " p"]]:
        inner, control = self.controller.step(memory.inner, plan, memory.estimate)
        predicted = self.model.step(self._update(memory, measurement), control)
        return ObserverMemory(predicted, inner), control


class DisturbedState(NamedTuple):
    """Estimates of the state x and of a constant load d of the controls; NumPy's on the host."""

    state: Float[Array, " n"] | Float[np.ndarray, " n"]
    disturbance: Float[Array, " p"] | Float[np.ndarray, " p"]


class OffsetFreeMemory(NamedTuple):
    """The predicted state and disturbance, and the memory of the wrapped controller."""

    estimate: Float[Array, " n"] | Float[np.ndarray, " n"]  # NumPy's on the host
    disturbance: Float[Array, " p"] | Float[np.ndarray, " p"]
    inner: Any


class _LoadObserver(Wrapper):
    """Filter form with a constant disturbance d of the controls.

        x(k+1) = A x + B (u + d)
    A control at its limit does not disturb the estimate, which is driven by the u that acts.

    Args:
        controller: fed the estimate.
        model: model of the machine without disturbance; its output is the tool.
        gain: filter gain L (n + p, q) of [x, d]; see `offset_free_gain`.
        measured: C (q, n) of the measurement.

    Raises:
        ValueError: as `FilterObserver`, for [x, d].
    """

    controller: Controller
    model: LinearPlant
    gain: Float[Array, "both q"] = eqx.field(converter=jnp.asarray)
    measured: Float[Array, "q n"] = eqx.field(converter=jnp.asarray)

    def __check_init__(self):
        A, C = with_disturbance(self.model, self.measured)
        check_gain(A, C, self.gain)

    def initial_memory(self, reference: Reference) -> OffsetFreeMemory:
        """The estimate starts where the reference says the run begins, undisturbed."""
        check_period(self.model.dt, reference)
        start = self.model.initial_state(reference.position[0], reference.start_increment)
        undisturbed = jnp.zeros(self.model.inputs, start.dtype)
        return OffsetFreeMemory(start, undisturbed, self.controller.initial_memory(reference))

    def step(
        self, memory: OffsetFreeMemory, plan: Any, measurement: Any
    ) -> tuple[OffsetFreeMemory, Float[Array, " p"]]:
        n = self.model.states
        correction = self.gain @ (row(measurement) - self.measured @ memory.estimate)
        filtered = memory.estimate + correction[:n]
        disturbance = memory.disturbance + correction[n:]
        inner, control = self.answer(memory.inner, plan, DisturbedState(filtered, disturbance))
        predicted = self.model.step(filtered, control + disturbance)
        return OffsetFreeMemory(predicted, disturbance, inner), control

    def with_integrals_held(
        self, before: OffsetFreeMemory, after: OffsetFreeMemory, holds: Any
    ) -> OffsetFreeMemory:
        """The load that is found is an integral."""
        return after._replace(disturbance=jnp.where(holds, before.disturbance, after.disturbance))

    @abc.abstractmethod
    def answer(
        self, inner: Any, plan: Any, known: DisturbedState
    ) -> tuple[Any, Float[Array, " p"]]:
        """Next memory of the wrapped controller, and the control that acts."""


class OffsetFreeObserver(_LoadObserver):
    """The disturbance is cancelled, u = u_inner - d: no constant load leaves an error.

    Args:
        controller: fed the estimate of x.
        limit: limit of the control, +-: one number or one for each; none when infinite.

    Raises:
        ValueError: as `FilterObserver`, for [x, d]; or a limit is not above zero.
    """

    limit: Float[Array, ""] | Float[Array, " p"] = eqx.field(converter=jnp.asarray, default=np.inf)

    def __check_init__(self):
        check_limit(self.limit)

    def answer(
        self, inner: Any, plan: Any, known: DisturbedState
    ) -> tuple[Any, Float[Array, " p"]]:
        """Control of the wrapped controller without the disturbance, cut by the limit."""
        inner, control = self.controller.step(inner, plan, known.state)
        return inner, jnp.clip(control - known.disturbance, -self.limit, self.limit)


class OffsetFreeWithLoad(_LoadObserver):
    """The wrapped controller receives the load, and cancels it within limits of its own.

    Args:
        controller: fed `DisturbedState`; its control acts as it is.
    """

    def answer(
        self, inner: Any, plan: Any, known: DisturbedState
    ) -> tuple[Any, Float[Array, " p"]]:
        return self.controller.step(inner, plan, known)


def kalman_gain(
    model: LinearPlant,
    control_noise: Deviation,
    measurement_noise: Deviation,
    measured: Float[ArrayLike, "q n"] | None = None,
) -> Float[Array, "n q"]:
    """Steady-state gain L = P C' (C P C' + V)^-1 of the Kalman filter.

    P solves the dual Riccati equation. The process noise enters with the control:
    W = B diag(control_noise^2) B', V = diag(measurement_noise^2). Lengths are rescaled to one
    measurement deviation before solving: in metres the equation is too badly scaled to trust.

    >>> from jcontour.plants.linear_machines import bridgeport
    >>> kalman_gain(bridgeport(), control_noise=1.0, measurement_noise=1e-6).shape
    (8, 2)

    Args:
        model: model of the machine.
        control_noise: standard deviation on each control (p,) or one for all.
        measurement_noise: standard deviation on each measurement (q,) or one for all; the largest
            sets the unit.
        measured: C (q, n) of the measurement; the model's outputs when not given.

    Raises:
        ValueError: the equation has no stabilising solution (a state that the sensors do not show
            does not die out).
    """
    C = model.C if measured is None else jnp.asarray(measured, model.A.dtype)
    dtype = model.A.dtype
    deviations = jnp.asarray(control_noise, dtype), jnp.asarray(measurement_noise, dtype)
    dual, gain = _designed(model.A, model.B, C, *deviations)
    check_dare(*dual)
    return gain


@jax.jit
def _designed(A, B, C, control_noise, measurement_noise):
    """Dual equation A', C', W and V, which is not checked, and the gain of its solution."""
    deviation = jnp.broadcast_to(measurement_noise, (C.shape[0],))
    unit = jnp.max(deviation)
    B = B * jnp.atleast_2d(control_noise) / unit
    W, V = B @ B.T, jnp.diag((deviation / unit) ** 2)
    PC = dare(A.T, C.T, W, V) @ C.T
    return (A.T, C.T, W, V), small_solve((C @ PC + V).T, PC.T).T


def offset_free_gain(
    model: LinearPlant,
    measured: Float[ArrayLike, "q n"],
    control_noise: Deviation,
    drift: Deviation,
    measurement_noise: Deviation,
) -> Float[Array, "both q"]:
    """Kalman filter gain (n + p, q) of [x, d] for `OffsetFreeObserver`, where d walks at random.

    Args:
        model: model of the machine without disturbance.
        measured: C (q, n) of the measurement.
        control_noise: standard deviation on each control (p,) or one for all.
        drift: standard deviation of the change of d per sample, likewise, in the unit of the
            control; a larger value integrates faster.
        measurement_noise: standard deviation on each measurement (q,) or one for all.

    Raises:
        ValueError: as `kalman_gain`.
    """
    A, C = with_disturbance(model, measured)
    sizes = (jnp.asarray(one, A.dtype) for one in (control_noise, drift))
    B, noise = _random_walk(model.B, *sizes)
    return kalman_gain(LinearPlant(A, B, C, model.dt), noise, measurement_noise)


def check_gain(
    A: Float[ArrayLike, "n n"],
    C: Float[ArrayLike, "q n"],
    gain: Float[ArrayLike, "rows columns"],
    name: str = "gain",
) -> None:
    """Raise ValueError unless the gain has the shape (n, q) and its observer is stable.

    The stability of traced values is not checked.
    """
    wanted, shape = (jnp.shape(A)[0], jnp.shape(C)[0]), jnp.shape(gain)
    if shape != wanted:
        raise ValueError(f"{name}: needs shape {wanted}, received {shape}")
    if is_concrete(A, C, gain):
        A, C, gain = np.asarray(A), np.asarray(C), np.asarray(gain)
        check_stable(f"{name}: the observer", A - A @ gain @ C)


def with_disturbance(
    model: LinearPlant, measured: Float[ArrayLike, "q n"]
) -> tuple[Float[Array, "both both"], Float[Array, "q both"]]:
    """Matrices A and C of [x, d], with n + p states; d is a constant load of the controls."""
    return _disturbed(model.A, model.B, jnp.asarray(measured, model.A.dtype))


# one program each, where they are called outside of one
@jax.jit
def _disturbed(A, B, C):
    n, p = B.shape
    both = jnp.eye(n + p, dtype=A.dtype).at[:n, :n].set(A).at[:n, n:].set(B)
    return both, jnp.concatenate([C, jnp.zeros((C.shape[0], p), C.dtype)], axis=1)


@jax.jit
def _random_walk(B: Float[Array, "n p"], control_noise: Array, drift: Array):
    """Entries of the noises of control and drift, and their deviations."""
    n, p = B.shape
    entries = jnp.zeros((n + p, 2 * p), B.dtype).at[:n, :p].set(B).at[n:, p:].set(jnp.eye(p))
    return entries, jnp.concatenate([jnp.broadcast_to(one, (p,)) for one in (control_noise, drift)])
