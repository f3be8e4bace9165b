"""The ways in which a tracking MPC predicts under loads that are not measured.

Absolute form: x_{j+1} = A x_j + B u_j, there are none.
Offset-free form: an observer estimates a constant load d of the controls,

    x_{j+1} = A x_j + B (u_j + d),
and u_j + d costs, what the machine feels. A constant load then leaves no error at rest.
Velocity form: the prediction goes on from the last change,

    x_{j+1} - x_j = A (x_j - x_{j-1}) + B (u_j - u_{j-1}),
the machine of Lam, eq. 6. Written in absolute controls it is the model under the constant
disturbance w = x_0 - A x_{-1} - B u_{-1}, so all forms share one QP. A constant load then leaves
no error at rest, as long as only increments cost.
"""

import abc
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jcontour.controllers.observers.kalman import DisturbedState
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.mpc.tracking.condense import Prediction
from jcontour.riccati.algebraic import check_dare, dare


class Disturbance(NamedTuple):
    """What acts on the prediction beside the controls, constant over the horizon.

    Attributes:
        state: w, x_{j+1} = A x_j + B (u_j + d) + w.
        control: d.
    """

    state: Float[np.ndarray, " n"]
    control: Float[np.ndarray, " p"]


class Form(abc.ABC):
    """The part of a tracking MPC that its form decides; it holds no numbers."""

    @abc.abstractmethod
    def check_weights(self, R: Float[np.ndarray, "p p"], S: Float[np.ndarray, "p p"]) -> None:
        """Raise ValueError unless the weights on control and increment suit the form."""

    @abc.abstractmethod
    def state(self, measurement: Any) -> Float[np.ndarray, " n"]:
        """State x_0, from what the controller is fed."""

    @abc.abstractmethod
    def disturbance(
        self,
        A: Float[np.ndarray, "n n"],
        B: Float[np.ndarray, "n p"],
        before: Float[np.ndarray, " n"],
        control: Float[np.ndarray, " p"],
        measurement: Any,
    ) -> Disturbance:
        """The constants w and d of the prediction.

        Args:
            A: of the model.
            B: of the model.
            before: x_{-1}, NaN before the first sample.
            control: u_{-1}, which acted on it.
            measurement: what the controller is fed.
        """

    @abc.abstractmethod
    def riccati(
        self,
        model: LinearPlant,
        Q: Float[np.ndarray, "m m"],
        R: Float[np.ndarray, "p p"],
        S: Float[np.ndarray, "p p"],
    ) -> Float[np.ndarray, "t t"]:
        """Cost beyond the horizon of xi_N, under an output weight Q.

        Raises:
            ValueError: the equation has no stabilising solution.
        """

    @abc.abstractmethod
    def terminal_maps(
        self, prediction: Prediction
    ) -> tuple[Float[np.ndarray, "t q"], Float[np.ndarray, "t z"]]:
        """Maps of s and z to xi_N."""

    @abc.abstractmethod
    def terminal_target(
        self,
        motion: SteadyMotion,
        end: Float[np.ndarray, "T m"],
        increment: Float[np.ndarray, "T m"],
    ) -> Float[np.ndarray, "T t"]:
        """xi_d of every step, from the reference's sample N and its last increment."""


class _WholeState(Form):
    """Common part of the absolute and the offset-free form: xi = x_N."""

    def check_weights(self, R, S) -> None:
        """Some weight on every control, on itself or on its increment."""
        if np.linalg.eigvalsh(R + S).min() <= 0:
            raise ValueError(
                "control, increment: every control needs a weight above zero, "
                "on itself or on its increment"
            )

    def riccati(self, model, Q, R, S) -> Float[np.ndarray, "t t"]:
        """Solution for C' Q C and R alone: the increments of the tail are not counted."""
        weight = np.asarray(model.C.T @ Q @ model.C)
        check_dare(model.A, model.B, weight, R)
        return np.asarray(dare(model.A, model.B, jnp.asarray(weight), jnp.asarray(R)))

    def terminal_maps(self, prediction):
        return prediction.Fx[-1], prediction.Gx[-1]

    def terminal_target(self, motion, end, increment) -> Float[np.ndarray, "T t"]:
        return np.asarray(motion.state(jnp.asarray(end), jnp.asarray(increment)))


class AbsoluteForm(_WholeState):
    """The model as it is, fed its state."""

    def state(self, measurement) -> Float[np.ndarray, " n"]:
        return measurement

    def disturbance(self, A, B, before, control, measurement) -> Disturbance:
        return Disturbance(np.zeros(A.shape[0]), np.zeros(B.shape[1]))


class OffsetFreeForm(_WholeState):
    """The model under a load of its controls, fed the estimate of both by `OffsetFreeHost`.

    >>> from jcontour.controllers.observers.kalman import offset_free_gain
    >>> from jcontour.host.observed import OffsetFreeHost
    >>> from jcontour.mpc.tracking.limits import Limits
    >>> from jcontour.mpc.tracking.tracking_mpc import TrackingMPC, TrackingWeights
    >>> from jcontour.plants.linear_machines import exact_bridgeport
    >>> table, limits = exact_bridgeport(), Limits.within(control=5.0)
    >>> weights = TrackingWeights(output=3.0, contour=5.0, control=2e-9)
    >>> mpc = TrackingMPC(table, weights, 10, limits, form=OffsetFreeForm())
    >>> gain = offset_free_gain(table, table.C, 0.05, 0.01, 1e-6)
    >>> OffsetFreeHost(mpc, table, gain, table.C).preview
    10
    """

    def state(self, measurement: DisturbedState) -> Float[np.ndarray, " n"]:
        return np.asarray(measurement.state)

    def disturbance(self, A, B, before, control, measurement: DisturbedState) -> Disturbance:
        return Disturbance(np.zeros(A.shape[0]), np.asarray(measurement.disturbance))


class VelocityForm(Form):
    """The changes: xi = (x_N - x_{N-1}, y_N), an integrator per output without an observer."""

    def state(self, measurement) -> Float[np.ndarray, " n"]:
        return measurement

    def check_weights(self, R, S) -> None:
        """No weight on the control itself: it would pull towards zero, which leaves an error."""
        if np.any(R):
            raise ValueError(
                "control: the velocity form weighs increments only, "
                "received a weight on the control"
            )
        if np.linalg.eigvalsh(S).min() <= 0:
            raise ValueError("increment: needs to be positive definite in the velocity form")

    def disturbance(self, A, B, before, control, measurement) -> Disturbance:
        """w = x_0 - A x_{-1} - B u_{-1}, zero in the first sample; d = 0."""
        none = np.zeros(B.shape[1])
        if np.isnan(before[0]):
            return Disturbance(np.zeros(A.shape[0]), none)
        return Disturbance(measurement - A @ before - B @ control, none)

    def riccati(self, model, Q, R, S) -> Float[np.ndarray, "t t"]:
        """Solution for the model of the changes, [dx, y], its increments at weight S."""
        A, B, C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
        n, m = len(A), len(C)
        changes = np.block([[A, np.zeros((n, m))], [C @ A, np.eye(m)]])
        pushed = np.concatenate([B, C @ B])
        weight = np.zeros((n + m, n + m))
        weight[n:, n:] = Q
        check_dare(changes, pushed, weight, S)
        return np.asarray(dare(*map(jnp.asarray, (changes, pushed, weight, S))))

    def terminal_maps(self, prediction):
        horizon, n, q = prediction.Fx.shape
        before = np.eye(n, q), np.zeros_like(prediction.Gx[-1])  # x_0, for a horizon of one
        if horizon > 1:
            before = prediction.Fx[-2], prediction.Gx[-2]
        F = np.concatenate([prediction.Fx[-1] - before[0], prediction.Fy[-1]])
        G = np.concatenate([prediction.Gx[-1] - before[1], prediction.Gy[-1]])
        return F, G

    def terminal_target(self, motion, end, increment) -> Float[np.ndarray, "T t"]:
        return np.concatenate([increment @ np.asarray(motion.Sy).T, end], axis=1)
