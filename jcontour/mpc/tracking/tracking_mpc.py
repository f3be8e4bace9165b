"""Tracking and contouring MPC: the receding-horizon LQ problems under limits, one QP per sample.

The cost is that of McNab & Tsao, eqs. 4-8 (see `ContouringLQ`, which the absolute form equals where
no limit is active),

    sum_{j=1}^{N-1} stage_j e_j' Q_j e_j + sum_{j=0}^{N-1} v_j' R v_j + du_j' S du_j + terminal,
    Q_j = Q + beta (I - t_j t_j'),   v_j = u_j - u_0,
u_0 the control that holds the machine where the run begins.
How the model predicts is the form's, see `forms`. A sample has three functions, which `step`
calls one after the other: `problem` builds the QP, the solver solves it, `applied` makes of the
answer the control and the next memory.
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
from jcontour.host.controller import HostController, Stepped, StepReport
from jcontour.linear.plant import LinearPlant, SteadyMotion, operating_point, steady_motion
from jcontour.motion.references import Reference
from jcontour.mpc.tracking.condense import Condensed, TerminalMaps, Window, predict
from jcontour.mpc.tracking.forms import AbsoluteForm, Form
from jcontour.mpc.tracking.limits import Limits, full_limits
from jcontour.qp.problem import QP, Solution, check_weight
from jcontour.qp.solvers import DAQP, Solver

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


class TrackingMemory(NamedTuple):
    """The control that acted last, and the state it acted on (NaN before the first sample)."""

    control: Float[np.ndarray, " p"]
    state: Float[np.ndarray, " n"]


class TrackingMPC(HostController):
    """A receding-horizon LQ controller under limits, fed the state (and the load, see `form`).

    Args:
        model: what the controller believes the machine to be.
        weights: of the cost.
        preview: horizon N [samples].
        limits: on control, increment, state, output, speed and acceleration.
        terminal: as `ContouringLQ` has them.
        solver: of the QPs; DAQP when not given, the fastest at these sizes.
        penalty: of the slack of soft limits (state, output, speed, acceleration) in the scaled
            problem; None keeps them hard.
        form: absolute when not given; the offset-free form, behind its observer, and the velocity
            form leave no offset under a constant load.

    Raises:
        ValueError: limits crossed, a weight not positive semidefinite or not for this form, no
            weight on the control, a horizon < 1.
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
        form: Form | None = None,
    ):
        self.model, self.weights = model, weights
        self.preview = whole_preview(preview)
        self.limits = full_limits(limits, model)
        self.terminal = OutputTerminal() if terminal is None else terminal
        self.solver = DAQP() if solver is None else solver
        self.form = AbsoluteForm() if form is None else form
        self._A, self._B = np.asarray(model.A), np.asarray(model.B)
        self._Q = _square("output", weights.output, model.axes)
        self._R = _square("control", weights.control, model.inputs)
        self._S = _square("increment", weights.increment, model.inputs)
        self._stage = _profile(weights.stage, self.preview)
        if not (np.isfinite(weights.contour) and weights.contour >= 0):
            raise ValueError(
                f"contour: needs a finite weight of at least zero, received {weights.contour}"
            )
        if penalty is not None and not (np.isfinite(penalty) and penalty > 0):
            raise ValueError(f"penalty: needs to be finite and above zero, received {penalty}")
        self.form.check_weights(self._R, self._S)
        prediction = predict(model, self.preview)
        self._P, maps = self._Q_max, (prediction.Fy[-1], prediction.Gy[-1])
        if isinstance(self.terminal, RiccatiTerminal):
            self._P = self.form.riccati(model, self._Q_max, self._R, self._S)
            maps = self.form.terminal_maps(prediction)
        self._condensed = self._with_penalty(maps, penalty)
        if penalty is None:
            self._softened = self._with_penalty(maps, EXACT_PENALTY)
        else:
            self._softened = self._condensed

    def prepare(self, reference: Reference) -> Window:
        """Windows of the reference, T in front, views wherever possible.

        Raises:
            ValueError: the reference looks less far ahead than the controller.
        """
        check_preview(self, reference)
        steps, N = reference.steps, self.preview
        position = np.asarray(reference.position)[: steps + N]
        tangent = np.asarray(reference.tangent)[: steps + N]
        across = np.eye(position.shape[1]) - tangent[:, :, None] * tangent[:, None, :]
        Q = self._Q + self.weights.contour * across
        end, before = position[N : N + steps], position[N - 1 : N - 1 + steps]
        P, xi_d = Q[N : N + steps], end
        if isinstance(self.terminal, RiccatiTerminal):
            P = np.broadcast_to(self._P, (steps, *self._P.shape))
            xi_d = self.form.terminal_target(self._motion, end, end - before)
        held = np.asarray(operating_point(self.model, reference.position[0]).control)
        return Window(
            _windows(Q[1:], N - 1, steps),
            _windows(position[1:], N - 1, steps),
            self._stage[-1] * P,
            xi_d,
            np.broadcast_to(held, (steps, held.size)),
        )

    def initial_memory(self, reference: Reference) -> TrackingMemory:
        """The control that keeps up the motion with which the reference says the run begins.

        Limits cut it.

        Raises:
            ValueError: that start is outside the limits.
        """
        position, increment = reference.position[0], reference.start_increment
        motion = self._motion
        state = np.asarray(motion.state(position, increment))
        onward = np.asarray(motion.state(position + increment, increment))
        control = np.linalg.lstsq(self._B, onward - self._A @ state, rcond=None)[0]
        _check_within("state", state, self.limits)
        _check_within("output", np.asarray(position), self.limits)
        _check_within("speed", np.asarray(increment) / self.model.dt, self.limits)
        assert self.limits.control is not None  # `full_limits` has filled it
        return TrackingMemory(np.clip(control, *self.limits.control), np.full(state.size, np.nan))

    def problem(
        self,
        memory: TrackingMemory,
        window: Window,
        measurement: Any,
        soft: bool = False,
        out: QP | None = None,
    ) -> QP:
        """The QP of a sample.

        Args:
            memory: of the sample before.
            window: one row of the plan.
            measurement: what the form is fed: the state, or `DisturbedState`.
            soft: limits on state, output, speed and acceleration give way.
            out: an earlier QP of the same kind to write over; new arrays when not given.
        """
        condensed = self._softened if soft else self._condensed
        before = memory.control
        w, d = self.form.disturbance(self._A, self._B, memory.state, before, measurement)
        # counted from the held control, the prediction is the same
        w, d = w + self._B @ window.held, d - window.held
        known = np.concatenate([self.form.state(measurement), before, w, d])
        return condensed.problem(known, window, out)

    def applied(self, solution: Solution, measurement: Any, soft: bool = False) -> Stepped:
        """Next memory, first control and report, from the solved QP of a sample."""
        condensed = self._softened if soft else self._condensed
        control = solution.z[: self.model.inputs].copy()
        acted = TrackingMemory(control, np.array(self.form.state(measurement)))
        moves, variables = condensed.moves, solution.z.size
        forces = solution.multipliers
        acting = int(np.count_nonzero(np.abs(condensed.of_first_control(forces)) > ACTIVE))
        if variables > moves:  # those of the slack are no limits
            forces = np.delete(forces, slice(moves, variables))
        active = int(np.count_nonzero(np.abs(forces) > ACTIVE))
        slack = condensed.slack(solution.z)
        report = StepReport(active, solution.residual, solution.iterations, slack, acting)
        return acted, control, report

    def step(self, memory: TrackingMemory, plan: Window, measurement: Any) -> Stepped:
        """Build, solve, apply the first control.

        Raises:
            Unsolved: the QP has no answer.
        """
        qp = self.problem(memory, plan, measurement)
        return self.applied(self.solver.solve(qp), measurement)

    def soft_step(self, memory: TrackingMemory, plan: Window, measurement: Any) -> Stepped:
        """The step with soft limits on state, output, speed and acceleration.

        It always has an answer.
        """
        qp = self.problem(memory, plan, measurement, soft=True)
        return self.applied(self.solver.solve(qp), measurement, soft=True)

    def held(self, memory: TrackingMemory, measurement: Any, control: Any) -> TrackingMemory:
        """The held control acts on the state measured now."""
        return TrackingMemory(control, np.array(self.form.state(measurement)))

    @property
    def _Q_max(self) -> Float[np.ndarray, "m m"]:
        return self._Q + self.weights.contour * np.eye(self.model.axes)

    @property
    def _motion(self) -> SteadyMotion:
        given = self.terminal.motion if isinstance(self.terminal, RiccatiTerminal) else None
        return steady_motion(self.model) if given is None else given

    def _with_penalty(self, maps: tuple, penalty: float | None) -> Condensed:
        return Condensed(
            self.model,
            self._R,
            self._S,
            self._stage,
            self._Q_max,
            TerminalMaps(*maps, self._stage[-1] * self._P),
            self.limits,
            penalty,
        )


def _square(name: str, weight: Any, size: int) -> Float[np.ndarray, "s s"]:
    weight = np.asarray(weight, float)
    if weight.shape in ((), (size,)):
        weight = np.diag(np.broadcast_to(weight, (size,)))
    if weight.shape != (size, size):
        received = weight.shape if weight.ndim > 1 else (1, *weight.shape)
        raise ValueError(
            f"{name}: needs a number, ({size},) or ({size}, {size}), received {received}"
        )
    check_weight(name, weight)
    return weight


def _profile(stage: ArrayLike | None, preview: int) -> Float[np.ndarray, " N"]:
    if stage is None:
        return np.ones(preview)
    profile = np.asarray(stage, float)
    if profile.shape != (preview,) or not (np.isfinite(profile) & (profile > 0)).all():
        raise ValueError(
            f"stage: needs {preview} finite entries above zero, one per preview sample, "
            f"received {stage}"
        )
    return profile


def _check_within(name: str, value: np.ndarray, limits: Limits) -> None:
    lower, upper = getattr(limits, name)
    below = value < lower - OUTSIDE * np.abs(lower)
    above = value > upper + OUTSIDE * np.abs(upper)
    if below.any() or above.any():
        raise ValueError(
            f"{name}: the start is outside the limits, {value} is not between {lower} and {upper}"
        )


def _windows(samples: np.ndarray, length: int, steps: int) -> np.ndarray:
    """Row k holds samples k..k+length-1, without copying."""
    shape, strides = (steps, length, *samples.shape[1:]), (samples.strides[0], *samples.strides)
    return np.lib.stride_tricks.as_strided(samples, shape, strides, writeable=False)
