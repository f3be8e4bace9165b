"""State observers around any state-feedback controller, for machines that measure positions only.

With innovation v = y - C xh and steady-state gain L:
    xf = xh + L v,    xh(k+1) = A xf + B u.
The filter form feeds xf to the controller (it has the current measurement in time), the predictor
form xh (it does not). The offset-free form estimates a constant disturbance d of the controls
beside the state, and cancels it; `integral_lqg` has an integral instead.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.controller import Controller, Wrapper, check_limit, check_period
from jcontour.linear.plant import LinearPlant, check_stable
from jcontour.motion.references import Reference
from jcontour.riccati.algebraic import check_dare, dare
from jcontour.sensors import row
from jcontour.tracing import is_concrete


class ObserverMemory(NamedTuple):
    """The predicted state xh, and the memory of the controller inside."""

    estimate: Float[Array, " n"] | Float[np.ndarray, " n"]  # NumPy's on the host
    inner: Any


def corrected(estimate, measurement, gain, measured):
    """Estimate that includes the measurement: xf = xh + L (y - C xh), in JAX or in NumPy."""
    return estimate + gain @ (measurement - measured @ estimate)


class _Observer(Wrapper):
    """What both forms share.

    Args:
        controller: fed the estimate.
        model: of the machine; its output is the tool.
        gain: the filter gain L (n, q).
        start: the first estimate; from the reference when not given.
        measured: C (q, n) of what the sensors show; the model's when not given.

    Raises:
        ValueError: the gain has the wrong shape, or A - A L C has an eigenvalue that is not inside
            the unit circle.
    """

    controller: Controller
    model: LinearPlant
    gain: Float[Array, "n q"]
    start: Float[Array, " n"] | None = None
    measured: Float[Array, "q n"] | None = None

    def __check_init__(self):
        check_gain(self.model.A, self._C, self.gain)

    @property
    def _C(self) -> Float[Array, "q n"]:
        return self.model.C if self.measured is None else self.measured

    def design_model(self) -> LinearPlant:
        """Model that it is designed on."""
        return self.model

    def initial_memory(self, reference: Reference) -> ObserverMemory:
        """The estimate starts where the reference says the run begins.

        Raises:
            ValueError: the reference has another sample period.
        """
        check_period(self.model.dt, reference)
        known = (
            self.model.initial_state(reference.position[0], reference.start_increment)
            if self.start is None
            else self.start
        )
        return ObserverMemory(known, self.controller.initial_memory(reference))

    def _update(self, memory: ObserverMemory, measurement: Any) -> Float[Array, " n"]:
        return corrected(memory.estimate, row(measurement), self.gain, self._C)


class FilterObserver(_Observer):
    """The controller acts on the estimate that includes the current measurement."""

    def step(
        self, memory: ObserverMemory, plan: Any, measurement: Any
    ) -> tuple[ObserverMemory, Float[Array, " p"]]:
        """Correct, control, predict."""
        filtered = self._update(memory, measurement)
        inner, control = self.controller.step(memory.inner, plan, filtered)
        return ObserverMemory(self.model.step(filtered, control), inner), control


class PredictorObserver(_Observer):
    """The controller acts on the prediction from the samples before: its control is ready when the sample is taken."""

    def step(
        self, memory: ObserverMemory, plan: Any, measurement: Any
    ) -> tuple[ObserverMemory, Float[Array, " p"]]:
        """Control, correct, predict."""
        inner, control = self.controller.step(memory.inner, plan, memory.estimate)
        return ObserverMemory(
            self.model.step(self._update(memory, measurement), control), inner
        ), control


class OffsetFreeMemory(NamedTuple):
    """The predicted state and disturbance, and the memory of the controller inside."""

    estimate: Float[Array, " n"]
    disturbance: Float[Array, " p"]
    inner: Any


class OffsetFreeObserver(Wrapper):
    """Filter form for x(k+1) = A x + B (u + d), d constant: u = u_inside - d_f, so that no constant load leaves an error.

    A control at its limit does not disturb the estimate, which is driven by the u that acts.

    Args:
        controller: fed the estimate of x.
        model: of the machine without disturbance; its output is the tool.
        gain: the filter gain L (n + p, q) of [x, d]; see `offset_free_gain`.
        measured: C (q, n) of what the sensors show.
        limit: of the control, +-: one number or one for each; none when infinite.

    Raises:
        ValueError: as `FilterObserver`, for [x, d]; or a limit is not above zero.
    """

    controller: Controller
    model: LinearPlant
    gain: Float[Array, "n+p q"]
    measured: Float[Array, "q n"]
    limit: Float[Array, "*p"] = eqx.field(converter=jnp.asarray, default=np.inf)

    def __check_init__(self):
        A, C = _with_disturbance(self.model, self.measured)
        check_gain(A, C, self.gain)
        check_limit(self.limit)

    def design_model(self) -> LinearPlant:
        """Model that it is designed on."""
        return self.model

    def initial_memory(self, reference: Reference) -> OffsetFreeMemory:
        """The estimate starts where the reference says the run begins, undisturbed.

        Raises:
            ValueError: the reference has another sample period.
        """
        check_period(self.model.dt, reference)
        start = self.model.initial_state(reference.position[0], reference.start_increment)
        return OffsetFreeMemory(
            start,
            jnp.zeros(self.model.inputs, start.dtype),
            self.controller.initial_memory(reference),
        )

    def step(
        self, memory: OffsetFreeMemory, plan: Any, measurement: Any
    ) -> tuple[OffsetFreeMemory, Float[Array, " p"]]:
        """Correct, control, cancel, predict: the model is driven by u + d."""
        correction = self.gain @ (row(measurement) - self.measured @ memory.estimate)
        filtered, disturbance = (
            memory.estimate + correction[: self.model.states],
            memory.disturbance + correction[self.model.states :],
        )
        inner, control = self.controller.step(memory.inner, plan, filtered)
        control = jnp.clip(control - disturbance, -self.limit, self.limit)
        return OffsetFreeMemory(
            self.model.step(filtered, control + disturbance), disturbance, inner
        ), control


def kalman_gain(
    model: LinearPlant, control_noise, measurement_noise, measured=None
) -> Float[Array, "n q"]:
    """Steady-state Kalman filter gain L = P C' (C P C' + V)^-1 with P from the dual Riccati equation.

    The process noise enters with the control: W = B diag(control_noise^2) B'; V =
    diag(measurement_noise^2). Lengths are rescaled to one measurement deviation before solving,
    because in metres the equation is too badly scaled to trust.

    Args:
        model: the machine.
        control_noise: standard deviation on each control (p,) or one for all.
        measurement_noise: standard deviation on each measurement, (q,) or one for all; that of the
            least precise sets the unit.
        measured: C (q, n) of what the sensors show; the model's outputs when not given.

    Raises:
        ValueError: the equation has no stabilising solution (a state that the sensors do not show
            does not die out).
    """
    C = model.C if measured is None else jnp.asarray(measured, model.A.dtype)
    deviation = jnp.broadcast_to(jnp.asarray(measurement_noise, model.A.dtype), (C.shape[0],))
    B = model.B * jnp.asarray(control_noise, model.A.dtype) / jnp.max(deviation)
    V = jnp.diag((deviation / jnp.max(deviation)) ** 2)
    check_dare(model.A.T, C.T, B @ B.T, V)
    return _filter_gain(model.A, B, C, V)


def offset_free_gain(
    model: LinearPlant, measured, control_noise, drift, measurement_noise
) -> Float[Array, "n+p q"]:
    """Kalman filter gain of [x, d] for `OffsetFreeObserver`, where d walks at random.

    Args:
        model: of the machine without disturbance.
        measured: C (q, n) of what the sensors show.
        control_noise: standard deviation on each control (p,) or one for all.
        drift: standard deviation of the change of d per sample, likewise, in the unit of the
            control; more of it integrates faster.
        measurement_noise: standard deviation on each measurement (q,) or one for all.

    Raises:
        ValueError: as `kalman_gain`.
    """
    A, C = _with_disturbance(model, measured)
    n, p = model.states, model.inputs
    B = jnp.zeros((n + p, 2 * p), A.dtype).at[:n, :p].set(model.B).at[n:, p:].set(jnp.eye(p))
    noise = jnp.concatenate(
        [jnp.broadcast_to(jnp.asarray(size, A.dtype), (p,)) for size in (control_noise, drift)]
    )
    return kalman_gain(LinearPlant(A, B, C, model.dt), noise, measurement_noise)


def check_gain(
    A: Float[Array, "n n"], C: Float[Array, "q n"], gain: Float[Array, "n q"], name: str = "gain"
) -> None:
    """Raise ValueError unless the gain has the shape (n, q) and its observer is stable; traced values pass unchecked."""
    if jnp.shape(gain) != (A.shape[0], C.shape[0]):
        raise ValueError(
            f"{name}: needs shape ({A.shape[0]}, {C.shape[0]}), received {jnp.shape(gain)}"
        )
    if is_concrete(A, C, gain):
        check_stable(f"{name}: the observer", A - A @ gain @ C)


def _with_disturbance(
    model: LinearPlant, measured
) -> tuple[Float[Array, "n+p n+p"], Float[Array, "q n+p"]]:
    n, p = model.states, model.inputs
    A = jnp.eye(n + p, dtype=model.A.dtype).at[:n, :n].set(model.A).at[:n, n:].set(model.B)
    measured = jnp.asarray(measured, model.A.dtype)
    return A, jnp.concatenate([measured, jnp.zeros((measured.shape[0], p), measured.dtype)], axis=1)


@jax.jit
def _filter_gain(A, B, C, V) -> Float[Array, "n m"]:
    PC = dare(A.T, C.T, B @ B.T, V) @ C.T
    return PC @ jnp.linalg.inv(C @ PC + V)
