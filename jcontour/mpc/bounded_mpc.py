"""MPC that keeps signals within limits along a nominal run, on a model that changes on the way.

With e = x - z(k), du = u - v(k) the deviations from the run (z, v), a sample solves

    minimise    sum_j |rows e_j|_Q^2 + |du_j|_R^2
    subject to  e_0 = x - z(k),   e_(j+1) = A_(k+j) e_j + B_(k+j) du_j,   e_N = 0,
                |value + row e_j| <= limit - h_(k+j)j,   |du_j| <= control_limit - h_(k+j)j
and applies u = v(k) + du_0. The h are the growth of the peaks in `jcontour.sets.responses`. If one
sample has an answer, every later one has, over all switches of the model: the plan, shifted by one
sample and answered by X_j w, U_j w, loses exactly what was kept. The constraint-tightened MPC of
Chisci, Rossiter & Zappa (2001) and Richards & How (2006), with responses of least peak. Yuan's
(4.20), (5.23), (5.26) and (5.43) constrain the nominal prediction only and are not recursively
feasible. A control that acts late is a state of the model, see `VaryingModel.with_input_delay`: the
controller remembers it.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.controller import check_preview
from jcontour.host.controller import HostController, Stepped, StepReport
from jcontour.motion.references import Reference
from jcontour.qp.problem import QP
from jcontour.qp.solvers import DAQP, Solver
from jcontour.sets.responses import Numbers, VaryingResponse

CONTROL_WEIGHT = 1e-3  # of a control's deviation over its limit; rows over their limits weigh one
TOO_SMALL = 1e-7  # of a limit: what a whole control changes in a row that is left out
ROUNDING = 1e-9  # of a limit, by which rows may be exceeded: certificates are floating point
ACTIVE = 1e-9  # smallest multiplier of a limit that counts as active, in the scaled problem


class KeptRows(NamedTuple):
    """Signals value + row e that are kept, at the R samples of the responses.

    Attributes:
        names: of the r signals.
        state: rows (R, r, n).
        value: on the nominal run (R, r).
        limit: largest magnitude (R, r).
    """

    names: tuple[str, ...]
    state: Float[np.ndarray, "R r n"]
    value: Float[np.ndarray, "R r"]
    limit: Float[np.ndarray, "R r"]


class LateMemory(NamedTuple):
    """Controls that do not act yet, the next one first (late, p)."""

    waiting: Float[np.ndarray, "late p"]


class BoundedPlan(NamedTuple):
    """Numbers of the QP of every sample; z are the deviations of the controls in units."""

    state: Float[np.ndarray, "*T n"]  # nominal state (T, n)
    control: Float[np.ndarray, "*T p"]  # nominal control (T, p)
    H: Float[np.ndarray, "*T z z"]  # weight (T, z, z)
    pull: Float[np.ndarray, "*T z n"]  # of the deviation e_0 (T, z, n)
    rows: Float[np.ndarray, "*T r z"]  # of the limits, then of the end (T, r, z)
    known: Float[np.ndarray, "*T r n"]  # what e_0 makes of them (T, r, n)
    # low, high: their bounds (T, r)
    low: Float[np.ndarray, "*T r"]
    high: Float[np.ndarray, "*T r"]
    most: Float[np.ndarray, "*T z"]  # largest |z| (T, z)


class BoundedMPC(HostController):
    """MPC that keeps rows, and its controls near those of the run, fed the state.

    Args:
        state: nominal z (R, n), of the samples of the responses at the least.
        control: nominal v (R, p).
        response: to the disturbances.
        kept: signals and their limits.
        control_limit: largest deviation of the controls from the run (R, p): what their limits
            leave, or less.
        late: samples by which controls act late, in the model's state.
        control_weight: on a control's deviation over its largest limit.
        solver: of the QPs; DAQP when not given.

    Raises:
        ValueError: shapes do not fit, or a limit is too small; it names the signal and sample.
    """

    def __init__(
        self,
        state: Numbers,
        control: Numbers,
        response: VaryingResponse,
        kept: KeptRows,
        control_limit: Numbers,
        late: int = 0,
        control_weight: float = CONTROL_WEIGHT,
        solver: Solver | None = None,
    ):
        self.response, self.kept = response, kept
        self.preview = 2 * response.length  # the plan, and the answers that begin at its end
        self.late, self.control_weight = late, control_weight
        self.solver = DAQP() if solver is None else solver
        R, (n, p) = response.samples, response.model.B.shape[1:]
        self.state, self.control = np.asarray(state, float)[:R], np.asarray(control, float)[:R]
        self.control_limit = np.asarray(control_limit, float)
        _check(self.state, self.control, self.control_limit, kept, (R, n, p))
        self.unit = self.control_limit.max(axis=0)
        still = np.zeros((R, len(kept.names), p))
        self.growth = response.growth(kept.state, still)
        each = np.broadcast_to(np.eye(p), (R, p, p))
        self.control_growth = response.growth(np.zeros((R, p, n)), each)
        names = [*kept.names, *(f"control {i + 1}" for i in range(p))]
        needed = np.concatenate([self.needs, self.control_growth[..., -1]], axis=1)
        limit = np.concatenate([kept.limit, self.control_limit], axis=1)
        share = needed / limit
        sample, worst = np.unravel_index(np.argmax(share), share.shape)
        if not share[sample, worst] <= 1:
            raise ValueError(
                f"{names[worst]}: run and disturbances need {needed[sample, worst]:.6g} at sample "
                f"{sample}, the limit is {limit[sample, worst]:.6g}"
            )

    @property
    def needs(self) -> Float[np.ndarray, "R r"]:
        """Largest magnitude of every kept signal: |value| and the disturbances' peak."""
        return np.abs(self.kept.value) + self.growth[..., -1]

    def prepare(self, reference: Reference) -> BoundedPlan:
        """QPs of every sample.

        Raises:
            ValueError: the preview is too short, or the run is shorter than the reference.
        """
        check_preview(self, reference)
        N, T = self.response.length, reference.steps
        if self.response.samples < T + N:
            raise ValueError(
                f"reference: its {T} steps need responses at {T + N} samples, "
                f"received {self.response.samples}"
            )
        at = np.arange(T)[:, None]
        powers, reach = self._reached(T)
        # rows of samples 1..N-1 of a plan, in shares of their limits
        stage = np.arange(1, N)
        limit = self.kept.limit[at + stage]
        c, now = self.kept.state[at + stage] / limit[..., None], self.kept.value[at + stage] / limit
        most = 1 + ROUNDING - self.growth[at + stage, :, stage] / limit
        low, high = (-most - now).reshape(T, -1), (most - now).reshape(T, -1)
        rows, known = (
            (c @ maps[:, 1:-1]).reshape(T, -1, maps.shape[-1]) for maps in (reach, powers)
        )
        turned = rows.transpose(0, 2, 1)
        H, pull = turned @ rows + self.control_weight * np.eye(rows.shape[2]), turned @ known
        largest = np.abs(H).max(axis=(1, 2), keepdims=True)
        units = np.abs(reach[:, -1]).max(axis=2, keepdims=True)
        units = np.where(units > 0, units, 1.0)
        end, still = reach[:, -1] / units, np.zeros((T, len(units[0])))
        idle = np.abs(rows).max(axis=2) < TOO_SMALL  # no control reaches these samples yet
        low, high = np.where(idle, -np.inf, low), np.where(idle, np.inf, high)
        ahead, stage = at + np.arange(N), np.arange(N)
        most = self.control_limit[ahead] * (1 + ROUNDING) - self.control_growth[ahead, :, stage]
        return BoundedPlan(
            self.state[:T],
            self.control[:T],
            H / largest,
            pull / largest,
            np.concatenate([rows, end], axis=1),
            np.concatenate([known, powers[:, -1] / units], axis=1),
            np.concatenate([low, still], axis=1),
            np.concatenate([high, still], axis=1),
            (most / self.unit).reshape(T, -1),
        )

    def initial_memory(self, reference: Reference) -> LateMemory:
        """Controls that wait are zero, as those of a delay line are."""
        return LateMemory(np.zeros((self.late, self.unit.size)))

    def step(self, memory: LateMemory, plan: BoundedPlan, measurement: Any) -> Stepped:
        """Solve, apply the first control.

        Raises:
            Unsolved: the QP has no answer, which happens only after a disturbance or the start has
                been outside its box.
        """
        x = np.concatenate([np.asarray(measurement, float), memory.waiting.ravel()])
        e = x - plan.state
        known = plan.known @ e
        low, high = plan.low - known, plan.high - known
        qp = QP(plan.H, plan.pull @ e, plan.rows, low, high, -plan.most, plan.most)
        answer = self.solver.solve(qp)
        control = plan.control + answer.z[: self.unit.size] * self.unit
        forces = np.abs(answer.multipliers[: answer.multipliers.size - len(e)])
        report = StepReport(
            int(np.count_nonzero(forces > ACTIVE)), answer.residual, answer.iterations
        )
        waiting = np.concatenate([memory.waiting, control[None]])[1:]
        return LateMemory(waiting), control, report

    def _reached(self, T: int) -> tuple[np.ndarray, np.ndarray]:
        """Maps to e_0..e_N from e_0 (T, N+1, n, n) and from the moves (T, N+1, n, z)."""
        model, N = self.response.model, self.response.length
        n, p = model.B.shape[1:]
        powers, reach = [np.broadcast_to(np.eye(n), (T, n, n))], [np.zeros((T, n, N * p))]
        for j in range(N):
            A, B = model.A[j : j + T], model.B[j : j + T]
            powers.append(A @ powers[-1])
            following = A @ reach[-1]
            following[:, :, j * p : (j + 1) * p] += B * self.unit
            reach.append(following)
        return np.stack(powers, axis=1), np.stack(reach, axis=1)


def _check(state, control, control_limit, kept: KeptRows, sizes: tuple[int, int, int]) -> None:
    R, n, p = sizes
    r = len(kept.names)
    fields = {
        "state": (state, (R, n)),
        "control": (control, (R, p)),
        "control_limit": (control_limit, (R, p)),
        "kept.state": (kept.state, (R, r, n)),
        "kept.value": (kept.value, (R, r)),
        "kept.limit": (kept.limit, (R, r)),
    }
    for name, (leaf, shape) in fields.items():
        if leaf.shape != shape:
            raise ValueError(f"{name}: needs shape {shape}, received {leaf.shape}")
    positive = (kept.limit > 0).all() and (control_limit > 0).all()
    if not (positive and np.isfinite(control_limit).all()):
        raise ValueError("control_limit, kept.limit: need to be above zero, the former finite")
