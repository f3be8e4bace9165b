"""Tracking and contouring MPC: the receding-horizon LQ problems under limits, one QP per sample.

Absolute form (`TrackingMPC`): the cost of McNab & Tsao, eqs. 4-8 (see `ContouringLQ`, which it
equals where no limit is active),
    sum_{j=1}^{N-1} stage_j e_j' Q_j e_j + sum_{j=0}^{N-1} u_j' R u_j + du_j' S du_j + terminal,
    Q_j = Q + beta (I - t_j t_j').
Velocity form (`OffsetFreeMPC`): the prediction goes on from the change seen last,
    x_{j+1} - x_j = A (x_j - x_{j-1}) + B (u_j - u_{j-1}),
the machine of Lam, eq. 6. Written in absolute controls it is the model under the constant
disturbance w = x_0 - A x_{-1} - B u_{-1}, so both forms share one QP. A constant load then leaves
no error at rest, as long as only increments cost.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

from jcontour.controller import check_preview, whole_preview
from jcontour.controllers.lq.contouring_lq import (
    LQWeights,
    OutputTerminal,
    RiccatiTerminal,
    Terminal,
)
from jcontour.host.loop import HostController, StepReport
from jcontour.linear.plant import LinearPlant, steady_motion
from jcontour.motion.references import Reference
from jcontour.mpc.condense import Condensed, predict
from jcontour.mpc.limits import Limits, full_limits
from jcontour.qp.problem import Solution, check_weight
from jcontour.qp.solvers import DAQP, Solver
from jcontour.riccati.algebraic import check_dare, dare

NO_LIMITS = Limits()
EXACT_PENALTY = 1e5  # far above the multipliers, which are of order one in the scaled problem
ACTIVE = 1e-9  # smallest multiplier of a limit that counts as active, in the scaled problem
OUTSIDE = 1e-9  # of a limit: a start beyond it by rounding is not outside


class TrackingWeights(NamedTuple):
    """Weights of the cost.

    Attributes:
        output: on the tracking error, number, (m,) or (m, m) [1/m^2].
        contour: beta, on the part of it across the path [1/m^2].
        control: on the control, number, (p,) or (p, p).
        increment: on its change per sample, likewise.
        stage: positive profile (N,) over the horizon, the last entry for the terminal; ones when
            not given.
    """

    output: ArrayLike
    contour: float = 0.0
    control: ArrayLike = 0.0
    increment: ArrayLike = 0.0
    stage: ArrayLike | None = None

    @classmethod
    def of(cls, weights: LQWeights) -> "TrackingWeights":
        """The weights that a tuned `ContouringLQ` has."""
        return cls(
            float(weights.alpha), float(weights.beta), float(weights.rho), 0.0, weights.stage
        )


class TrackingPlan(NamedTuple):
    """Windows of the reference, T in front: Q (T, N-1, m, m), y_d (T, N-1, m), P (T, t, t), xi_d (T, t)."""

    Q: np.ndarray
    y_d: np.ndarray
    P: np.ndarray
    xi_d: np.ndarray


class TrackingMemory(NamedTuple):
    """The control that acted last, and the state it acted on (NaN before the first sample)."""

    control: Float[np.ndarray, " p"]
    state: Float[np.ndarray, " n"]


class TrackingMPC(HostController):
    """Absolute form, fed the state.

    Args:
        model: what the controller believes the machine to be.
        weights: of the cost.
        preview: horizon N [samples].
        limits: on control, increment, state, output, speed and acceleration.
        terminal: as `ContouringLQ` has them.
        solver: of the QPs; DAQP when not given, the fastest at these sizes.
        penalty: of the slack of soft limits (state, output, speed, acceleration) in the scaled
            problem; None keeps them hard.

    Raises:
        ValueError: limits crossed, a weight not positive semidefinite, no weight on the control, a
            horizon < 1.
    """

    def __init__(
        self,
        model: LinearPlant,
        weights: TrackingWeights,
        preview: int,
        limits: Limits = NO_LIMITS,
        terminal: Terminal | None = None,
        solver: Solver | None = None,
        penalty: float | None = None,
    ):
        self.model, self.preview, self.limits = (
            model,
            whole_preview(preview),
            full_limits(limits, model),
        )
        self.terminal = OutputTerminal() if terminal is None else terminal
        self.solver, self.weights = DAQP() if solver is None else solver, weights
        m, p = model.axes, model.inputs
        self._Q = _square("output", weights.output, m)
        self._R, self._S = (
            _square("control", weights.control, p),
            _square("increment", weights.increment, p),
        )
        self._stage = (
            np.ones(self.preview) if weights.stage is None else np.asarray(weights.stage, float)
        )
        if (
            self._stage.shape != (self.preview,)
            or not (np.isfinite(self._stage) & (self._stage > 0)).all()
        ):
            raise ValueError(
                f"stage: needs {self.preview} finite entries above zero, one per preview sample, received {weights.stage}"
            )
        if not (np.isfinite(weights.contour) and weights.contour >= 0):
            raise ValueError(
                f"contour: needs a finite weight of at least zero, received {weights.contour}"
            )
        if penalty is not None and not (np.isfinite(penalty) and penalty > 0):
            raise ValueError(f"penalty: needs to be finite and above zero, received {penalty}")
        self._check_control_weight()
        self._A, self._B = np.asarray(model.A), np.asarray(model.B)
        self._build(penalty)
        self._report, self.solution = StepReport(), None

    def prepare(self, reference: Reference) -> TrackingPlan:
        """Windows of the reference, views wherever possible.

        Raises:
            ValueError: the reference looks less far ahead than the controller.
        """
        check_preview(self, reference)  # type: ignore  # reads `preview` alone
        steps, N = reference.steps, self.preview
        position, tangent = (
            np.asarray(reference.position)[: steps + N],
            np.asarray(reference.tangent)[: steps + N],
        )
        across = np.eye(position.shape[1]) - tangent[:, :, None] * tangent[:, None, :]
        Q = self._Q + self.weights.contour * across
        end, before = position[N : N + steps], position[N - 1 : N - 1 + steps]
        P, xi_d = self._terminal_plan(Q[N : N + steps], end, end - before)
        return TrackingPlan(
            _windows(Q[1:], N - 1, steps),
            _windows(position[1:], N - 1, steps),
            self._stage[-1] * P,
            xi_d,
        )

    def initial_memory(self, reference: Reference) -> TrackingMemory:
        """The control that keeps up the motion with which the reference says the run begins, or what the limits leave of it.

        Raises:
            ValueError: that start is outside the limits.
        """
        position, increment = reference.position[0], reference.start_increment
        motion = self._motion()
        state, onward = (
            np.asarray(motion.state(at, increment)) for at in (position, position + increment)
        )
        control = np.linalg.lstsq(self._B, onward - self._A @ state, rcond=None)[0]
        for name, value in (
            ("state", state),
            ("output", np.asarray(position)),
            ("speed", np.asarray(increment) / self.model.dt),
        ):
            lower, upper = getattr(self.limits, name)
            if (value < lower - OUTSIDE * np.abs(lower)).any() or (
                value > upper + OUTSIDE * np.abs(upper)
            ).any():
                raise ValueError(
                    f"{name}: the start is outside the limits, {value} is not between {lower} and {upper}"
                )
        return TrackingMemory(np.clip(control, *self.limits.control), np.full(state.size, np.nan))  # type: ignore

    def step(
        self, memory: TrackingMemory, plan: TrackingPlan, measurement
    ) -> tuple[TrackingMemory, Float[np.ndarray, " p"]]:
        """Fill, solve, apply the first control.

        Raises:
            Unsolved: the QP has no answer.
        """
        return self._solved(self._problem, memory, plan, measurement)

    def soft_step(self, memory, plan, measurement):
        """The step with soft limits on state, output, speed and acceleration; it always has an answer."""
        return self._solved(self._softened(), memory, plan, measurement)

    def held(self, memory: TrackingMemory, measurement, control) -> TrackingMemory:
        """The held control acts on the state measured now."""
        self._report = StepReport()
        return TrackingMemory(control, np.array(measurement))

    def report(self) -> StepReport:
        """Limits active, residual, iterations and slack of the last step."""
        return self._report

    def _solved(self, problem: Condensed, memory, plan, measurement):
        s = np.concatenate([measurement, memory.control, self._disturbance(memory, measurement)])
        self.solution = solution = self.solver.solve(
            problem.update(s, plan.Q, plan.y_d, plan.P, plan.xi_d)
        )
        control = solution.z[: self.model.inputs].copy()
        self._report = _report(problem, solution)
        return TrackingMemory(control, np.array(measurement)), control

    def _disturbance(self, memory: TrackingMemory, state) -> np.ndarray:
        return np.zeros(state.size)

    def _motion(self):
        given = self.terminal.motion if isinstance(self.terminal, RiccatiTerminal) else None
        return steady_motion(self.model) if given is None else given

    def _softened(self) -> Condensed:
        if self._soft is None:
            self._soft = self._condensed(EXACT_PENALTY)
        return self._soft

    def _build(self, penalty: float | None) -> None:
        self._prediction = predict(self.model, self.preview)
        self._P = self._riccati() if isinstance(self.terminal, RiccatiTerminal) else self._Q_max
        self._problem = self._condensed(penalty)
        self._soft = self._problem if penalty is not None else None

    def _condensed(self, penalty: float | None) -> Condensed:
        terminal = (*self._terminal_maps(), self._stage[-1] * self._P)
        return Condensed(
            self.model, self._R, self._S, self._stage, self._Q_max, terminal, self.limits, penalty
        )

    @property
    def _Q_max(self) -> np.ndarray:
        return self._Q + self.weights.contour * np.eye(self.model.axes)

    # what the form decides

    def _check_control_weight(self) -> None:
        if np.linalg.eigvalsh(self._R + self._S).min() <= 0:
            raise ValueError(
                "control, increment: every control needs a weight above zero, on itself or on its increment"
            )

    def _riccati(self) -> np.ndarray:
        """H_s(Q_max): R alone, the increments of the tail are not counted."""
        Q = np.asarray(self.model.C.T @ self._Q_max @ self.model.C)
        check_dare(self.model.A, self.model.B, Q, self._R)
        return np.asarray(dare(self.model.A, self.model.B, Q, self._R))  # type: ignore

    def _terminal_maps(self) -> tuple[np.ndarray, np.ndarray]:
        """xi_N: the last state under the Riccati cost, else the last output."""
        one = self._prediction
        return (
            (one.Fx[-1], one.Gx[-1])
            if isinstance(self.terminal, RiccatiTerminal)
            else (one.Fy[-1], one.Gy[-1])
        )

    def _terminal_plan(self, Q_N, end, increment) -> tuple[np.ndarray, np.ndarray]:
        """P and xi_d of every step."""
        if not isinstance(self.terminal, RiccatiTerminal):
            return Q_N, end
        return np.broadcast_to(self._P, (len(end), *self._P.shape)), np.asarray(
            self._motion().state(end, increment)
        )


class OffsetFreeMPC(TrackingMPC):
    """Velocity form, fed the state: an integrator per output, by prediction rather than by an observer.

    The Riccati terminal is that of the changes: xi = (x_N - x_{N-1}, y_N), the increments at weight
    S.

    Raises:
        ValueError: as `TrackingMPC`; a weight on the control itself (it would pull towards zero
            control, which leaves an error).
    """

    def _check_control_weight(self) -> None:
        if np.any(self._R):
            raise ValueError(
                "control: the velocity form weighs increments only, received a weight on the control"
            )
        if np.linalg.eigvalsh(self._S).min() <= 0:
            raise ValueError("increment: needs to be positive definite in the velocity form")

    def _disturbance(self, memory: TrackingMemory, state) -> np.ndarray:
        if np.isnan(memory.state[0]):
            return np.zeros(state.size)
        return state - self._A @ memory.state - self._B @ memory.control

    def _riccati(self) -> np.ndarray:
        A, B, C = self._A, self._B, np.asarray(self.model.C)
        n, m = len(A), len(C)
        changes = np.block([[A, np.zeros((n, m))], [C @ A, np.eye(m)]])
        Q = np.zeros((n + m, n + m))
        Q[n:, n:] = self._Q_max
        check_dare(changes, np.concatenate([B, C @ B]), Q, self._S)
        return np.asarray(dare(changes, np.concatenate([B, C @ B]), Q, self._S))  # type: ignore

    def _terminal_maps(self):
        one = self._prediction
        if not isinstance(self.terminal, RiccatiTerminal):
            return one.Fy[-1], one.Gy[-1]
        n, q = one.Fx.shape[1:]
        Fx, Gx = (
            (one.Fx[-2], one.Gx[-2])
            if self.preview > 1
            else (np.eye(n, q), np.zeros_like(one.Gx[-1]))
        )
        return np.concatenate([one.Fx[-1] - Fx, one.Fy[-1]]), np.concatenate(
            [one.Gx[-1] - Gx, one.Gy[-1]]
        )

    def _terminal_plan(self, Q_N, end, increment):
        if not isinstance(self.terminal, RiccatiTerminal):
            return Q_N, end
        change = increment @ np.asarray(self._motion().Sy).T
        return np.broadcast_to(self._P, (len(end), *self._P.shape)), np.concatenate(
            [change, end], axis=1
        )


def _report(problem: Condensed, solution: Solution) -> StepReport:
    forces = (
        np.delete(solution.multipliers, slice(problem.moves, solution.z.size))
        if solution.z.size > problem.moves
        else solution.multipliers
    )
    active = int(np.count_nonzero(np.abs(forces) > ACTIVE))
    return StepReport(active, solution.residual, solution.iterations, problem.slack(solution.z))


def _square(name: str, weight: Any, size: int) -> np.ndarray:
    weight = np.asarray(weight, float)
    if weight.ndim < 2:
        weight = (
            np.diag(np.broadcast_to(weight, (size,)))
            if weight.shape in ((), (size,))
            else weight[None]
        )
    if weight.shape != (size, size):
        raise ValueError(
            f"{name}: needs a number, ({size},) or ({size}, {size}), received {weight.shape}"
        )
    check_weight(name, weight)
    return weight


def _windows(samples: np.ndarray, length: int, steps: int) -> np.ndarray:
    """Row k holds samples k..k+length-1, without copying."""
    shape, strides = (steps, length, *samples.shape[1:]), (samples.strides[0], *samples.strides)
    return np.lib.stride_tricks.as_strided(samples, shape, strides, writeable=False)
