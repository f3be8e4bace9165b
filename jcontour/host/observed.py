"""The observers of `kalman`, in front of a host controller."""

from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike, Float

from jcontour.controller import check_period
from jcontour.controllers.observers.kalman import (
    DisturbedState,
    ObserverMemory,
    OffsetFreeMemory,
    check_gain,
    corrected,
    with_disturbance,
)
from jcontour.host.controller import HostController, HostWrapper
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference


class ObservedHost(HostWrapper):
    """The controller acts on the estimate that includes the current measurement.

    Args:
        controller: fed the state.
        model: of the machine.
        gain: the filter gain L (n, m), as `kalman_gain` gives it.

    Raises:
        ValueError: the gain has the wrong shape.
    """

    def __init__(self, controller: HostController, model: LinearPlant, gain: ArrayLike):
        super().__init__(controller)
        self.model = model
        self._gain = np.asarray(gain, float)
        self._A, self._B, self._C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
        if self._gain.shape != (model.states, model.axes):
            raise ValueError(
                f"gain: needs shape ({model.states}, {model.axes}), received {self._gain.shape}"
            )

    def initial_memory(self, reference: Reference) -> ObserverMemory:
        known = self.model.initial_state(reference.position[0], reference.start_increment)
        return ObserverMemory(np.asarray(known), self.controller.initial_memory(reference))

    def enter(self, memory: ObserverMemory, measurement: Any) -> Float[np.ndarray, " n"]:
        return corrected(memory.estimate, measurement, self._gain, self._C)

    def leave(self, memory: ObserverMemory, fed: Any, inner: Any, control: Any):
        """The predicted estimate A xf + B u, and the control as it is."""
        return ObserverMemory(self._A @ fed + self._B @ control, inner), control


class OffsetFreeHost(HostWrapper):
    """The controller acts on the estimates of state and load, as `OffsetFreeObserver` makes them.

        x(k+1) = A x + B (u + d)
    The controller answers with u itself, the control that acts: it is told d and cancels it, so
    that its limits hold for u.

    Args:
        controller: fed `DisturbedState`, as a `TrackingMPC` in `OffsetFreeForm` is.
        model: of the machine without load.
        gain: the filter gain L (n + p, q) of [x, d], as `offset_free_gain` gives it.
        measured: C (q, n) of the measurement.

    Raises:
        ValueError: the gain or C has the wrong shape, or the observer is not stable.
    """

    def __init__(
        self,
        controller: HostController,
        model: LinearPlant,
        gain: ArrayLike,
        measured: ArrayLike,
    ):
        super().__init__(controller)
        self.model = model
        self._gain, self._C = np.asarray(gain, float), np.asarray(measured, float)
        if self._C.ndim != 2 or self._C.shape[1] != model.states:
            needed = f"shape (q, {model.states})"
            raise ValueError(f"measured: needs {needed}, received {self._C.shape}")
        check_gain(*with_disturbance(model, self._C), self._gain)
        self._A, self._B = np.asarray(model.A), np.asarray(model.B)

    def initial_memory(self, reference: Reference) -> OffsetFreeMemory:
        """The estimate starts where the reference says the run begins, without a load.

        Raises:
            ValueError: the reference has another sample period.
        """
        check_period(self.model.dt, reference)
        known = self.model.initial_state(reference.position[0], reference.start_increment)
        unloaded = np.zeros(self.model.inputs)
        return OffsetFreeMemory(
            np.asarray(known), unloaded, self.controller.initial_memory(reference)
        )

    def enter(self, memory: OffsetFreeMemory, measurement: Any) -> DisturbedState:
        """The corrected estimates of state and load."""
        n, leaves = self.model.states, jax.tree.leaves(measurement)
        measured = np.concatenate([np.ravel(leaf) for leaf in leaves])
        estimate, load = np.asarray(memory.estimate), np.asarray(memory.disturbance)
        correction = self._gain @ (measured - self._C @ estimate)
        return DisturbedState(estimate + correction[:n], load + correction[n:])

    def leave(self, memory: OffsetFreeMemory, fed: DisturbedState, inner: Any, control: Any):
        """The predicted estimate A xf + B (u + d), and the control as it is."""
        predicted = self._A @ fed.state + self._B @ (control + fed.disturbance)
        return OffsetFreeMemory(predicted, fed.disturbance, inner), control
