"""Tracking and contouring MPC that keeps a tolerance under every disturbance in a box.

    x(k+1) = A x(k) + B u(k) + E w(k),   |w_i| <= 1
Along the nominal run (z, v) of `nominal_runs`, with e = x - z, a sample solves

    minimise    sum_j |C (e_j + sum_{i<j} X_i w^)|_Q^2 + |du_j + sum_{i<j} U_i w^|_R^2
    subject to  e_0 = x - z(k),   e_{j+1} = A e_j + B du_j,   e_N = 0,
                |signal of sample k+j| <= limit - h_j,
and applies u = v(k) + du_0. X, U are the finite responses of `jcontour.sets`, h_j the growth of a
signal's peak under them. If one sample has an answer, every later one has: the plan, shifted by one
sample and answered by X_j w, U_j w, loses exactly the room h_{j+1} - h_j that was kept. The
constraint-tightened MPC of Chisci, Rossiter & Zappa (2001) and Richards & How (2006), with
responses of least peak. Yuan's (4.20), (5.23), (5.26) constrain the nominal prediction only and are
not recursively feasible.

w^ = E^+ (x - A x_- - B u_-), the disturbance that has just acted, is in the cost alone: feasibility
does not depend on it. Responses with sum_j C X_j = 0 leave no error under a constant load.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import linprog

from jcontour.controller import check_period, check_preview
from jcontour.host.controller import HostController, Stepped, StepReport
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference
from jcontour.mpc.bounded.bounded_qp import BoundedQP, BoundedWeights, Sample
from jcontour.mpc.bounded.nominal_runs import NominalRun, nominal_run
from jcontour.mpc.bounded.tolerance_rows import Frames, frames_of
from jcontour.qp.problem import Solution
from jcontour.qp.solvers import DAQP, Solver
from jcontour.sets.disturbed_model import DisturbedModel, Numbers, Signal
from jcontour.sets.least_peaks import LeastPeak, least_peak

SPARE = 1.02  # of the least tolerance: at the least one nothing is left to optimise
INSIDE = 1 + 1e-6  # of the box: a disturbance beyond it by rounding is not outside
NOMINAL_ERROR = 0.05  # of the disturbances' peak: error of the nominal run that costs as much as
NOMINAL_CHANGE = 0.1  # of the control's limit, a change of it per sample
DIRECTIONS = 4  # over half a turn, whose peaks the responses make small


class BoundedLimits(NamedTuple):
    """Limits beside the tolerance.

    Attributes:
        control: largest magnitude, one number or (p,).
        signals: further signals of state and control with their limits, see `speed_signals`.
    """

    control: Numbers
    signals: tuple[Signal, ...] = ()


class BoundedMemory(NamedTuple):
    """Control and state of the sample before, and what is known of the disturbances.

    Attributes:
        control: that acted last (p,).
        state: it acted on (n,); NaN before the first sample.
        sample: number of the next one.
        left: sample at which the disturbance first left its box; -1 if it never has.
        largest: largest disturbance so far, 1 at the edge of its box; infinite where no
            disturbance of these columns explains the state.
    """

    control: Float[np.ndarray, " p"]
    state: Float[np.ndarray, " n"]
    sample: int
    left: int
    largest: float


class Need(NamedTuple):
    """What a path and the disturbances take of a limit.

    Attributes:
        signal: and its limit.
        sample: where the path takes most.
        value: that it takes there.
        peak: that the disturbances add at most.
    """

    signal: Signal
    sample: int
    value: float
    peak: float


class BoundedPlan(NamedTuple):
    """One row per sample: the nominal state and control, and the rows of the QP.

    Attributes:
        state: z (T, n).
        sample: what changes in the QP, leading axis T.
    """

    state: Float[np.ndarray, "T n"]
    sample: Sample


def bounded_response(
    model: LinearPlant,
    disturbed: DisturbedModel,
    limits: BoundedLimits,
    length: int,
    offset_free: bool = True,
) -> LeastPeak:
    """Finite responses whose largest peak of the tool, in any direction, is the least.

    Args:
        model: the machine.
        disturbed: its A, B and the sizes E of the disturbances.
        limits: on the control and on further signals.
        length: samples after which the answer to a disturbance has come to rest.
        offset_free: a constant disturbance leaves no error; costs some of the tolerance.

    Raises:
        NoResponse: no response of this length respects the limits; it names what is too small.
        ValueError: bad input.
    """
    angles = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    C = np.asarray(model.C)
    rows = C if model.axes == 1 else around @ C
    names = [f"tool {i + 1}" for i in range(len(rows))]
    small = disturbed.state_signals(names, rows)
    limited = [*disturbed.control_signals(limits.control), *limits.signals]
    return least_peak(disturbed, small, limited, length, C if offset_free else None)


def speed_signals(model: LinearPlant, limit: Numbers, unknown: Numbers = 0.0) -> tuple[Signal, ...]:
    """Speed (y_{k+1} - y_k) / dt of every axis as a signal of state and control [m/s].

    The disturbance that acts in between is in neither: its share comes off the limit.

    Args:
        model: the machine.
        limit: one number or one for each axis [m/s].
        unknown: most that speeds differ from the signal, `Knowledge.speed`.

    Raises:
        ValueError: nothing of a limit is left.
    """
    A, B, C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
    sizes, taken = np.broadcast_arrays(
        np.asarray(limit, float), np.asarray(unknown, float), np.empty(model.axes)
    )[:2]
    for axis, (size, share) in enumerate(zip(sizes, taken, strict=True)):
        if not size > share:
            raise ValueError(
                f"speed {axis + 1}: disturbances alone make {share:.6g}, the limit is {size:.6g}"
            )
    state, control = C @ (A - np.eye(len(A))) / model.dt, C @ B / model.dt
    names = [f"speed {i + 1}" for i in range(model.axes)]
    return tuple(map(Signal, names, state, control, (sizes - taken).tolist()))


class BoundedMPC(HostController):
    """MPC that never exceeds its tolerance, fed the state.

    Args:
        model: the machine.
        least: responses, as `bounded_response` makes them for its disturbances.
        limits: on the control and on further signals.
        tolerance: largest distance of the tool from the path, on one axis largest tracking error
            [m]; 2 % above the least that the path allows when not given.
        weights: of the cost.
        solver: of the QPs; DAQP when not given.

    Raises:
        ValueError: shapes do not fit, a limit is too small, or a weight is not above zero.
    """

    def __init__(
        self,
        model: LinearPlant,
        least: LeastPeak,
        limits: BoundedLimits,
        tolerance: float | None = None,
        weights: BoundedWeights | None = None,
        solver: Solver | None = None,
    ):
        self.model, self.least, self.response = model, least, least.response
        self.preview = 2 * self.response.length  # the plan, and as much for the nominal run's end
        self.tolerance = tolerance
        self.weights = BoundedWeights() if weights is None else weights
        self.solver = DAQP() if solver is None else solver
        control = np.broadcast_to(np.asarray(limits.control, float), (model.inputs,))
        _check(model, self.response, control, tolerance, self.weights)
        finite = tuple(signal for signal in limits.signals if np.isfinite(signal.limit))
        self.limits = BoundedLimits(control, finite)
        disturbed = self.response.model
        self._A, self._B, self._E = disturbed
        self._estimate = np.linalg.pinv(self._E)
        scale = least.tolerance if tolerance is None else tolerance
        self._qp = BoundedQP(model, self.response, control, finite, self.weights, scale)

    def certified(self, reference: Reference) -> Frames:
        """Frames of a reference: the tolerance that each sample can be promised.

        Raises:
            ValueError: as `prepare`, but for the tolerance.
        """
        return self._frames(reference)[0]

    def needs(self, reference: Reference) -> list[Need]:
        """What the path and the disturbances take of every limit.

        Raises:
            ValueError: as `prepare`, but for what the limits do not allow.
        """
        return self._needs(self._frames(reference)[1], reference.steps)

    def promised(self, frames: Frames, steps: int) -> float:
        """Tolerance that is kept along these frames [m].

        Raises:
            ValueError: the tolerance asked for is below the least; it names the sample.
        """
        least = frames.certified[: steps + self.response.length]
        worst = int(np.argmax(least))
        if self.tolerance is None:
            return SPARE * float(least[worst])
        if self.tolerance < least[worst]:
            raise ValueError(
                f"tolerance: {self.tolerance:.6g} m is too small, sample {worst} needs "
                f"{least[worst]:.6g} m: {frames.peak[worst, -1]:.3g} m for the disturbances, "
                f"{abs(frames.nominal[worst, -1]):.3g} m for the nominal run, "
                f"{frames.off[worst]:.3g} m for the bend of the path; the disturbances' share is "
                f"limited by {', '.join(self.least.limiting) or 'the machine alone'}"
            )
        return self.tolerance

    def prepare(self, reference: Reference) -> BoundedPlan:
        """Nominal run and rows of every sample.

        Raises:
            ValueError: the preview is too short, the tolerance too small, or the nominal run leaves
                no room to a limit: it names the limit and the sample.
        """
        check_preview(self, reference)
        frames, run = self._frames(reference)
        room = frames.room(self.promised(frames, reference.steps))
        for need in self._needs(run, reference.steps):
            if need.value + need.peak > need.signal.limit:
                raise ValueError(
                    f"{need.signal.name}: the path needs {need.value:.6g} at sample {need.sample}, "
                    f"the disturbances {need.peak:.6g} more, the limit is "
                    f"{need.signal.limit:.6g}; drive more slowly"
                )
        sample = self._qp.samples(frames, room, run, reference.steps)
        return BoundedPlan(run.state[: reference.steps], sample)

    def initial_memory(self, reference: Reference) -> BoundedMemory:
        """No disturbance is known; the control holds the machine at the start.

        Raises:
            ValueError: the reference has another sample period; as `LinearPlant.holding_control`.
        """
        check_period(self.model.dt, reference)
        held = np.array(self.model.holding_control(reference.position[0]))
        return BoundedMemory(held, np.full(self.model.states, np.nan), 0, -1, 0.0)

    def step(self, memory: BoundedMemory, plan: BoundedPlan, measurement: Any) -> Stepped:
        """Build, solve, apply the first control.

        Raises:
            Unsolved: the QP has no answer, which happens only after the disturbance or the start
                has been outside what was promised.
        """
        state = np.asarray(measurement, float)
        disturbance, size = self._disturbance(memory, state)
        qp = self._qp.problem(plan.sample, state - plan.state, disturbance)
        return self._applied(memory, plan, state, size, self.solver.solve(qp), 0.0)

    def soft_step(self, memory: BoundedMemory, plan: BoundedPlan, measurement: Any) -> Stepped:
        """The step that gives up the tolerance, and other limits where it must.

        The control's limit holds.
        """
        state = np.asarray(measurement, float)
        disturbance, size = self._disturbance(memory, state)
        qp = self._qp.softened(plan.sample, state - plan.state, disturbance)
        found = self.solver.solve(qp)
        return self._applied(memory, plan, state, size, found, self._qp.slack(found))

    def held(self, memory: BoundedMemory, measurement: Any, control: Any) -> BoundedMemory:
        """The held control acts on the state measured now."""
        state = np.asarray(measurement, float)
        return _remembered(memory, state, control, self._disturbance(memory, state)[1])

    def _frames(self, reference: Reference) -> tuple[Frames, NominalRun]:
        length = NOMINAL_ERROR * self.least.tolerance
        change = NOMINAL_CHANGE * np.asarray(self.limits.control)
        run = nominal_run(self.model, reference, length, change)
        C = np.asarray(self.model.C)
        return frames_of(reference, run.state[:-1] @ C.T, C, self.response), run

    def _needs(self, run: NominalRun, steps: int) -> list[Need]:
        used = slice(0, steps + self.response.length)
        states, controls = run.state[:-1][used], run.control[used]
        limits = self.response.model.control_signals(self.limits.control)
        found = []
        for signal in [*limits, *self.limits.signals]:
            values = np.abs(states @ signal.state + controls @ signal.control)
            worst = int(np.argmax(values))
            found.append(Need(signal, worst, float(values[worst]), self.response.peak(signal)))
        return found

    def _disturbance(self, memory: BoundedMemory, state: np.ndarray) -> tuple[np.ndarray, float]:
        """Disturbance that has just acted, taken into its box, and its size in boxes."""
        if np.isnan(memory.state).any():
            return np.zeros(self._E.shape[1]), 0.0
        rest = state - self._A @ memory.state - self._B @ memory.control
        found = self._estimate @ rest
        rounding = 1e-9 * (np.abs(self._E).max(axis=1) + np.abs(state) * 1e-3)
        if (np.abs(rest - self._E @ found) > rounding).any():
            return np.clip(found, -1.0, 1.0), np.inf
        size = float(np.abs(found).max(initial=0.0))
        if size > INSIDE and np.linalg.matrix_rank(self._E) < self._E.shape[1]:
            found, size = _smallest(self._E, rest, found, size)
        return np.clip(found, -1.0, 1.0), size

    def _applied(self, memory, plan, state, size: float, found: Solution, slack: float) -> Stepped:
        control = self._qp.control(plan.sample, found)
        report = StepReport(self._qp.active(found), found.residual, found.iterations, slack)
        return _remembered(memory, state, control, size), control, report


def _remembered(
    memory: BoundedMemory, state: np.ndarray, control: np.ndarray, size: float
) -> BoundedMemory:
    """Memory after a sample; the disturbance was found at it, so it acted one sample before."""
    left = memory.left
    if left < 0 and size > INSIDE:
        left = memory.sample - 1
    return BoundedMemory(
        np.array(control), state.copy(), memory.sample + 1, left, max(memory.largest, size)
    )


def _smallest(E: np.ndarray, rest: np.ndarray, found: np.ndarray, size: float):
    """Disturbance of the least size among all that explain the state."""
    units = np.where(np.abs(E).max(axis=1) > 0, np.abs(E).max(axis=1), 1.0)[:, None]
    q = E.shape[1]
    rows = np.block([[np.eye(q), -np.ones((q, 1))], [-np.eye(q), -np.ones((q, 1))]])
    answer = linprog(
        np.append(np.zeros(q), 1.0),
        rows,
        np.zeros(2 * q),
        np.concatenate([E / units, np.zeros((len(E), 1))], axis=1),
        (rest[:, None] / units)[:, 0],
        bounds=(None, None),
        method="highs",
    )
    return (answer.x[:-1], float(answer.x[-1])) if answer.status == 0 else (found, size)


def _check(model, response, control, tolerance, weights) -> None:
    disturbed = response.model
    same = np.array_equal(disturbed.A, model.A) and np.array_equal(disturbed.B, model.B)
    if not same:
        raise ValueError("least: its responses are those of another model")
    if not (np.isfinite(control) & (control > 0)).all():
        raise ValueError(f"control: needs finite limits above zero, received {control}")
    if tolerance is not None and not (np.isfinite(tolerance) and tolerance > 0):
        raise ValueError(f"tolerance: needs to be finite and above zero, received {tolerance}")
    fine = weights.output >= 0 and weights.contour >= 0 and weights.control > 0
    if not (fine and np.isfinite(weights).all()):
        raise ValueError(f"weights: need to be finite, that of the control above zero: {weights}")
