"""Model predictive contouring control (Lam, Manzie & Good): the controller chooses the speed along the path itself.

    theta(k+1) = theta(k) + v(k),   0 <= v <= v_max,   -L <= theta <= 0                        (9)
The tool follows the path at the parameter theta; contour error and lag behind theta, both
linearised along the plan of one sample before, progress and changes of control and speed share one
QP (16), see `contouring_qp`. The model is in velocity form with a unit input delay (6): u(k), found
at k, acts during [k+1, k+2), and no constant disturbance leaves an offset.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

from jcontour.geometry.contour import Contour
from jcontour.host.loop import HostController, StepReport
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference
from jcontour.mpc.compiled_path import path_of
from jcontour.mpc.contouring_qp import condensed, write_step
from jcontour.qp.problem import QP, check_limits, check_weight
from jcontour.qp.solvers import DAQP, Solver

ARRIVAL = 1e-5  # [m] how near its end the tool has to come before the run is over
AT_END = 1e-9  # of the path's length: theta is at the end but for rounding


@dataclass(frozen=True)
class ContouringWeights:
    """Weights of (12), in the unit of length and for the sample period for which they are stated; the defaults are the paper's.

    At another sample period the same integrals over time are weighed: nothing needs to be restated.

    Attributes:
        contour_error: q_c, per length_unit^2.
        lag: q_l, per length_unit^2.
        progress: q_theta, per length_unit; more of it is faster and less accurate.
        control_change: R_x, R_y: one number, one for each input, or a matrix (p, p); per A^2.
        speed_change: R_v, per (length_unit per period)^2.
        length_unit: [m]; the QP is solved in it.
        period: [s].

    Raises:
        ValueError: a weight is negative or not finite, the changes' are zero, or unit or period is
            not above zero.
    """

    contour_error: float = 100.0
    lag: float = 200.0
    progress: float = 0.3  # the middle of the paper's range 0.03 .. 5
    control_change: Any = 60.0
    speed_change: float = 200.0
    length_unit: float = 1e-3
    period: float = 4e-3

    def __post_init__(self):
        for name in ("contour_error", "lag", "progress"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise ValueError(
                    f"{name}: needs to be finite and at least zero, received {getattr(self, name)}"
                )
        for name in ("speed_change", "length_unit", "period"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(
                    f"{name}: needs to be finite and above zero, received {getattr(self, name)}"
                )

    def control_matrix(self, inputs: int) -> Float[np.ndarray, "p p"]:
        """R_u as a matrix.

        Raises:
            ValueError: it has another shape, or is not symmetric and positive definite.
        """
        R = np.asarray(self.control_change, float)
        if R.ndim < 2:
            if R.size not in (1, inputs):
                raise ValueError(
                    f"control_change: needs one number or one for each of {inputs} inputs, received shape {R.shape}"
                )
            R = np.diag(np.broadcast_to(R, (inputs,)))
        if R.shape != (inputs, inputs):
            raise ValueError(f"control_change: needs shape {(inputs, inputs)}, received {R.shape}")
        check_weight("control_change", R)
        if not np.linalg.eigvalsh(R).min() > 0:
            raise ValueError(
                "control_change: needs to be positive definite, received a singular matrix"
            )
        return R


class Traversal(NamedTuple):
    """Memory of `MPCC`: where it is on the path and what it has decided.

    Attributes:
        theta: path parameter [length unit], -L at the start and 0 at the end.
        plan: speeds v of the blocks solved last [length unit per weights.period].
        control: u(k-1), solved last; it acts from now on.
        before: u(k-2).
        state: x(k-1).
        steps: made so far.
    """

    theta: np.ndarray
    plan: Float[np.ndarray, " B"]
    control: Float[np.ndarray, " p"]
    before: Float[np.ndarray, " p"]
    state: Float[np.ndarray, " n"]
    steps: int


class MPCC(HostController):
    """Contouring along any contour in two or more axes, closed (one lap) or open, corners included.

    The whole state of the model is measured. The reference says where the run starts (its first arc
    length) and how long it may take.

    Args:
        model: the plant at the controller's sample period, without the delay that the controller
            brings.
        contour: the path.
        lower: least controls, one number or one for each input.
        upper: largest controls.
        speed_limit: of the path parameter [m/s]; 1 mm per 4 ms in the paper.
        weights: see there.
        horizon: N samples, or the lengths of blocks over which controls and path speed are held:
            errors count at their ends.
        solver: any of `solvers`.
        arrival: distance [m] from the end of the path within which the run is over once theta is
            there.

    Raises:
        ValueError: the contour has other axes than the model or no length, limits are crossed,
            horizon or a block is below one sample, speed limit or arrival is not above zero, or a
            weight does not fit.
    """

    preview = 0

    def __init__(
        self,
        model: LinearPlant,
        contour: Contour,
        lower: ArrayLike = -0.5,
        upper: ArrayLike = 0.5,
        speed_limit: float = 0.25,
        weights: ContouringWeights | None = None,
        horizon: int | Sequence[int] = 7,
        solver: Solver | None = None,
        arrival: float = ARRIVAL,
    ):
        self.model, self.contour, self.weights = (
            model,
            contour,
            ContouringWeights() if weights is None else weights,
        )
        self.blocks, self.solver, self.arrival = (
            _blocks(horizon),
            DAQP() if solver is None else solver,
            arrival,
        )
        w, p, count = self.weights, model.inputs, len(self.blocks)
        if contour.axes != model.axes:
            raise ValueError(
                f"contour: needs as many axes as the model has outputs, {model.axes}, received {contour.axes}"
            )
        for name, value in (("speed_limit", speed_limit), ("arrival", arrival)):
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name}: needs to be finite and above zero, received {value}")
        lower, upper = _limit("lower", lower, p), _limit("upper", upper, p)
        check_limits("lower, upper", lower, upper)
        self.path = path_of(contour, w.length_unit)
        self.length = self.path.length
        self._end = self.path.at(self.length)[0]
        self._constant = condensed(
            model,
            w.length_unit,
            self.blocks,
            w.contour_error,
            w.lag,
            w.progress,
            w.control_matrix(p),
            w.speed_change,
            w.period,
        )
        self._output = np.asarray(model.C) / w.length_unit
        self._travel = model.dt / w.period  # theta gained in one sample at v = 1
        self._theta_hat, size, fastest = (
            np.zeros(count),
            count * (1 + p),
            speed_limit * w.period / w.length_unit,
        )
        row = np.append(self._constant.share, np.zeros(count * p))[None]
        self.qp = QP(
            np.zeros((size, size)),
            np.zeros(size),
            row,
            np.array([-np.inf]),
            np.zeros(1),
            np.append(np.zeros(count), np.tile(lower, count)),
            np.append(np.full(count, fastest), np.tile(upper, count)),
        )
        self._solution = None

    def prepare(self, reference: Reference) -> None:
        """Nothing: the path is known at construction, and the speed along it is the controller's own choice."""
        return None

    def initial_memory(self, reference: Reference) -> Traversal:
        """At the first arc length of the reference, at rest, with zero controls behind.

        Raises:
            ValueError: the sample periods differ, the reference's contour is longer than theta
                reaches or it starts beyond the path, or zero control is outside the limits.
        """
        self._check_run(reference)
        count, p, n = len(self.blocks), self.model.inputs, self.model.states
        theta = float(reference.arc[0]) / self.weights.length_unit - self.length
        return Traversal(
            np.array(min(theta, 0.0)), np.zeros(count), np.zeros(p), np.zeros(p), np.zeros(n), 0
        )

    def step(
        self, memory: Traversal, plan, measurement
    ) -> tuple[Traversal, Float[np.ndarray, " p"]]:
        """u(k-1), which acts now, and in the memory u(k), which acts one sample later.

        Raises:
            Unsolved: the QP was not solved.
        """
        self.write_qp(memory, measurement)
        self._solution = solution = self.solver.solve(self.qp)
        count, z = len(self.blocks), solution.z
        theta = min(memory.theta + self._travel * max(z[0], 0.0), 0.0)
        control = z[count : count + memory.control.size].copy()
        return Traversal(
            np.array(theta),
            z[:count].copy(),
            control,
            memory.control,
            measurement,
            memory.steps + 1,
        ), memory.control

    def write_qp(self, memory: Traversal, measurement: Float[np.ndarray, " n"]) -> QP:
        """The QP of a step, in place: the arrays are the same at every step. Variables [v, u], see `contouring_qp`."""
        write_step(
            self._constant,
            self.path,
            self._output,
            float(memory.theta),
            memory.plan,
            memory.control,
            memory.before,
            memory.state if memory.steps else measurement,
            measurement,
            self._theta_hat,
            self.qp.H,
            self.qp.g,
            self.qp.upper_rows,
        )
        return self.qp

    def held(self, memory: Traversal, measurement, control) -> Traversal:
        """The path parameter stands still for the sample, and the control acts on."""
        return memory._replace(
            control=control,
            before=memory.control,
            plan=0 * memory.plan,
            state=measurement,
            steps=memory.steps + 1,
        )

    def finished(self, memory: Traversal) -> bool:
        """Whether theta is at the end of the path and the tool was there, within `arrival`, one sample ago."""
        if memory.theta < -AT_END * self.length or not memory.steps:
            return False
        return bool(
            np.linalg.norm(self._output @ memory.state - self._end) * self.weights.length_unit
            <= self.arrival
        )

    def report(self) -> StepReport:
        """Of the step made last."""
        found = self._solution
        if found is None:
            return StepReport()
        return StepReport(
            int(np.count_nonzero(found.multipliers)), found.residual, found.iterations
        )

    def arc(self, memory: Traversal) -> np.ndarray:
        """Path parameter from the start [m]; of a whole rollout too."""
        return (np.asarray(memory.theta) + self.length) * self.weights.length_unit

    def speed(self, memory: Traversal) -> np.ndarray:
        """Path speed decided last [m/s]; of a whole rollout too."""
        return np.asarray(memory.plan)[..., 0] * self.weights.length_unit / self.weights.period

    def _check_run(self, reference: Reference) -> None:
        unit = self.weights.length_unit
        longer = float(reference.contour.length) / unit - self.length
        if abs(reference.dt - self.model.dt) > 1e-12 * self.model.dt:
            raise ValueError(
                f"dt: the controller's model is sampled every {self.model.dt} s, the reference every {reference.dt} s"
            )
        if longer > AT_END * self.length:
            raise ValueError(
                f"contour: the reference's is {float(reference.contour.length)} m long, theta reaches over {self.length * unit} m"
            )
        arc = float(reference.arc[0])
        if not -AT_END <= arc / (unit * self.length) <= 1 + AT_END:
            raise ValueError(
                f"reference: needs to start on the path, between 0 and {self.length * unit} m, received {arc} m"
            )
        p = self.model.inputs
        low, high = self.qp.lower[-p:], self.qp.upper[-p:]
        if not ((low <= 0) & (0 <= high)).all():
            raise ValueError(
                f"lower, upper: the run starts with zero control, which needs to be within the limits, received {low} and {high}"
            )


def growing_blocks(samples: int, count: int) -> tuple[int, ...]:
    """A horizon of `samples` in `count` blocks, the first of one sample and the others longer and longer: their ends follow a parabola.

    Raises:
        ValueError: count is below two, or there are too few samples for it.
    """
    if not (count >= 2 and samples >= count and samples == int(samples) and count == int(count)):
        raise ValueError(
            f"count: needs at least two blocks of at least one sample, received {count} blocks of {samples} samples"
        )
    ends = np.round(1 + (samples - 1) * (np.arange(count) / (count - 1)) ** 2)
    ends = np.maximum(ends, np.arange(1, count + 1))
    return tuple(int(length) for length in np.diff(ends, prepend=0))


def _blocks(horizon) -> np.ndarray:
    numbers = np.asarray(horizon, float)
    if (
        numbers.ndim > 1
        or not numbers.size
        or not (
            np.isfinite(numbers).all()
            and (numbers == np.round(numbers)).all()
            and numbers.min() >= 1
        )
    ):
        raise ValueError(
            f"horizon: needs a whole number of samples of at least one, or such lengths of blocks, received {horizon}"
        )
    return np.ones(int(numbers), int) if numbers.ndim == 0 else numbers.astype(int)


def _limit(name: str, value, inputs: int) -> Float[np.ndarray, " p"]:
    value = np.asarray(value, float)
    if value.shape not in ((), (1,), (inputs,)):
        raise ValueError(
            f"{name}: needs one number or one for each of {inputs} inputs, received shape {value.shape}"
        )
    return np.broadcast_to(value, (inputs,)).copy()
