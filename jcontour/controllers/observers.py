"""State observers around any state-feedback controller, for machines that measure positions only.

With innovation v = y - C xh and steady-state gain L:
    xf = xh + L v,    xh(k+1) = A xf + B u.
The filter form feeds xf to the controller (it has the current measurement in time), the predictor form xh (it does not).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import Controller, Wrapper
from jcontour.linear import LinearPlant
from jcontour.references import Reference
from jcontour.riccati import check_dare, dare


class ObserverMemory(NamedTuple):
    """The predicted state xh, and the memory of the controller inside."""

    estimate: Float[Array, " n"]
    inner: Any


class _Observer(Wrapper):
    """What both forms share; `gain` is the filter gain L (n, m), `start` the first estimate (from the reference when None)."""

    controller: Controller
    model: LinearPlant
    gain: Float[Array, "n m"]
    start: Float[Array, " n"] | None = None

    def initial_memory(self, reference: Reference) -> ObserverMemory:
        """The estimate starts where the reference says the run begins."""
        known = self.model.initial_state(reference.position[0], reference.start_increment) if self.start is None else self.start
        return ObserverMemory(known, self.controller.initial_memory(reference))

    def _update(self, memory: ObserverMemory, measurement: Float[Array, " m"]) -> Float[Array, " n"]:
        return memory.estimate + self.gain @ (measurement - self.model.C @ memory.estimate)


class FilterObserver(_Observer):
    """The controller acts on the estimate that includes the current measurement."""

    def step(self, memory: ObserverMemory, plan: Any, measurement: Float[Array, " m"]) -> tuple[ObserverMemory, Float[Array, " p"]]:
        """Correct, control, predict."""
        filtered = self._update(memory, measurement)
        inner, control = self.controller.step(memory.inner, plan, filtered)
        return ObserverMemory(self.model.step(filtered, control), inner), control


class PredictorObserver(_Observer):
    """The controller acts on the prediction from the samples before: its control is ready when the sample is taken."""

    def step(self, memory: ObserverMemory, plan: Any, measurement: Float[Array, " m"]) -> tuple[ObserverMemory, Float[Array, " p"]]:
        """Control, correct, predict."""
        inner, control = self.controller.step(memory.inner, plan, memory.estimate)
        return ObserverMemory(self.model.step(self._update(memory, measurement), control), inner), control


def kalman_gain(model: LinearPlant, control_noise, measurement_noise) -> Float[Array, "n m"]:
    """Steady-state Kalman filter gain L = P C' (C P C' + V)^-1 with P from the dual Riccati equation.

    The process noise enters with the control: W = B diag(control_noise^2) B'; V = diag(measurement_noise^2). Lengths are
    rescaled to one measurement deviation before solving, because in metres the equation is too badly scaled to trust.

    Args:
        model: the machine; its state is estimated from its outputs.
        control_noise: standard deviation on each control (p,) or one for all.
        measurement_noise: standard deviation on each output [m], (m,) or one for all.

    Raises:
        ValueError: the equation has no stabilising solution (a state that the outputs do not show does not die out).
    """
    deviation = jnp.broadcast_to(jnp.asarray(measurement_noise, model.A.dtype), (model.axes,))
    B = model.B * jnp.asarray(control_noise, model.A.dtype) / jnp.max(deviation)
    V = jnp.diag((deviation / jnp.max(deviation)) ** 2)
    check_dare(model.A.T, model.C.T, B @ B.T, V)
    return _filter_gain(model.A, B, model.C, V)


@jax.jit
def _filter_gain(A, B, C, V) -> Float[Array, "n m"]:
    PC = dare(A.T, C.T, B @ B.T, V) @ C.T
    return PC @ jnp.linalg.inv(C @ PC + V)
