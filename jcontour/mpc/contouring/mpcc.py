"""Model predictive contouring control (Lam, Manzie & Good): it chooses the speed along the path.

    theta(k+1) = theta(k) + v(k),   0 <= v <= v_max,   -L <= theta <= 0                        (9)
The tool follows the path at the parameter theta. Contour error and lag behind theta, both
linearised along the plan of one sample before, progress and changes of control and speed share one
QP (16), see `contouring_qp`. The model is in velocity form with a unit input delay (6): u(k), found
at k, acts during [k+1, k+2), and no constant disturbance leaves an offset.

A sample has three functions, which `step` calls one after the other: `problem` builds the QP, the
solver solves it, `applied` makes of the answer the control and the next memory.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour._arrays import check_above_zero
from jcontour.geometry.contour import Contour
from jcontour.host.controller import HostController, Stepped, StepReport
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference
from jcontour.mpc.contouring.contouring_qp import (
    ContouringWeights,
    Sample,
    contouring_constants,
    path_of,
    write_step,
)
from jcontour.mpc.tracking.limits import Bounds, bounds
from jcontour.qp.problem import QP, Solution
from jcontour.qp.solvers import DAQP, Solver

ARRIVAL = 1e-5  # [m] how near its end the tool has to come before the run is over
AT_END = 1e-9  # of the path's length: theta is at the end but for rounding


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
    """Contouring along any contour of one to three axes, closed (one lap) or open, with corners.

    The whole state of the model is measured. The reference says where the run starts (its first arc
    length) and how long it may take.

    Args:
        model: the plant at the controller's sample period, without the delay that the controller
            brings.
        contour: the path.
        control: least and largest controls, each one number or one for each input.
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
        control: Bounds = (-0.5, 0.5),
        speed_limit: float = 0.25,
        weights: ContouringWeights | None = None,
        horizon: int | float | Sequence[int] = 7,
        solver: Solver | None = None,
        arrival: float = ARRIVAL,
    ):
        self.model, self.contour, self.arrival = model, contour, arrival
        self.weights = ContouringWeights() if weights is None else weights
        numbers = np.asarray(horizon, float)
        whole = np.isfinite(numbers).all() and (numbers == np.round(numbers)).all()
        if numbers.ndim > 1 or not numbers.size or not (whole and numbers.min() >= 1):
            raise ValueError(
                "horizon: needs a whole number of samples of at least one, or such lengths of "
                f"blocks, received {horizon}"
            )
        self.blocks = np.ones(int(numbers), int) if numbers.ndim == 0 else numbers.astype(int)
        self.solver = DAQP() if solver is None else solver
        if contour.axes != model.axes:
            raise ValueError(
                f"contour: needs as many axes as the model has outputs, {model.axes}, "
                f"received {contour.axes}"
            )
        check_above_zero(speed_limit=speed_limit, arrival=arrival)
        lower, upper = bounds("control", control, model.inputs)
        self.path = path_of(contour, self.weights.length_unit)
        self.length = self.path.length
        self._end = self.path.at(self.length)[0]
        self._constants = contouring_constants(model, self.weights, self.blocks)
        self._travel = model.dt / self.weights.period  # theta gained in one sample at v = 1
        count = len(self.blocks)
        fastest = speed_limit * self.weights.period / self.weights.length_unit
        self._lower = np.append(np.zeros(count), np.tile(lower, count))
        self._upper = np.append(np.full(count, fastest), np.tile(upper, count))
        self._row = np.append(self._constants.share, np.zeros(count * model.inputs))[None]

    def prepare(self, reference: Reference) -> None:
        """Nothing: the path is known at construction, and the speed is chosen on the way."""
        return None

    def initial_memory(self, reference: Reference) -> Traversal:
        """At the first arc length of the reference, at rest, behind it the control that holds it.

        Raises:
            ValueError: the axes or the sample periods differ, the reference's contour is longer
                than theta reaches or it starts beyond the path, or the control that holds the
                machine there is outside the limits; as `LinearPlant.holding_control`.
        """
        reach = self.length * self.weights.length_unit  # [m]
        axes = reference.position.shape[-1]
        if axes != self.model.axes:
            raise ValueError(
                f"reference: needs as many axes as the model has outputs, {self.model.axes}, "
                f"received {axes}"
            )
        if abs(reference.dt - self.model.dt) > 1e-12 * self.model.dt:
            raise ValueError(
                f"dt: the controller's model is sampled every {self.model.dt} s, "
                f"the reference every {reference.dt} s"
            )
        longest = float(reference.contour.length)
        if longest / self.weights.length_unit - self.length > AT_END * self.length:
            raise ValueError(
                f"contour: the reference's is {longest} m long, theta reaches over {reach} m"
            )
        arc = float(reference.arc[0])
        if not -AT_END <= arc / reach <= 1 + AT_END:
            raise ValueError(
                f"reference: needs to start on the path, between 0 and {reach} m, received {arc} m"
            )
        held = np.array(self.model.holding_control(reference.position[0]))
        p = self.model.inputs
        low, high = self._lower[-p:], self._upper[-p:]
        if not ((low <= held) & (high >= held)).all():
            raise ValueError(
                f"control: the machine is held at the start by {held}, which needs to be "
                f"within the limits, received {low} and {high}"
            )
        theta = float(reference.arc[0]) / self.weights.length_unit - self.length
        plan, state = np.zeros(len(self.blocks)), np.zeros(self.model.states)
        return Traversal(np.array(min(theta, 0.0)), plan, held, held, state, 0)

    def problem(
        self, memory: Traversal, measurement: Float[np.ndarray, " n"], out: QP | None = None
    ) -> QP:
        """The QP of a sample, its variables [v, u]; see `contouring_qp`.

        Args:
            memory: of the sample before.
            measurement: the state now.
            out: an earlier QP of this controller whose H, g and upper_rows are written over; new
                arrays when not given.
        """
        qp = self._blank() if out is None else out
        state = memory.state if memory.steps else measurement
        sample = Sample(
            float(memory.theta), memory.plan, memory.control, memory.before, state, measurement
        )
        write_step(self._constants, self.path, sample, qp.H, qp.g, qp.upper_rows)
        return qp

    def applied(
        self, solution: Solution, memory: Traversal, measurement: Float[np.ndarray, " n"]
    ) -> Stepped:
        """Next memory, u(k-1) and report, from the solved QP of a sample."""
        count, z = len(self.blocks), solution.z
        theta = min(memory.theta + self._travel * max(z[0], 0.0), 0.0)
        control = z[count : count + memory.control.size].copy()
        following = Traversal(
            np.array(theta),
            z[:count].copy(),
            control,
            memory.control,
            measurement,
            memory.steps + 1,
        )
        active = int(np.count_nonzero(solution.multipliers))
        report = StepReport(active, solution.residual, solution.iterations)
        return following, memory.control, report

    def step(self, memory: Traversal, plan: Any, measurement: Any) -> Stepped:
        """u(k-1), which acts now, and in the memory u(k), which acts one sample later.

        Raises:
            Unsolved: the QP was not solved.
        """
        solution = self.solver.solve(self.problem(memory, measurement))
        return self.applied(solution, memory, measurement)

    def held(self, memory: Traversal, measurement: Any, control: Any) -> Traversal:
        """The path parameter stands still for the sample, and the control acts on."""
        return memory._replace(
            control=control,
            before=memory.control,
            plan=0 * memory.plan,
            state=measurement,
            steps=memory.steps + 1,
        )

    def finished(self, memory: Traversal) -> bool:
        """Whether theta is at the end of the path, and the tool was one sample ago."""
        if memory.theta < -AT_END * self.length or not memory.steps:
            return False
        apart = np.linalg.norm(self._constants.output @ memory.state - self._end)
        return bool(apart * self.weights.length_unit <= self.arrival)

    def arc(self, memory: Traversal) -> np.ndarray:
        """Path parameter from the start [m]; of a whole rollout too."""
        return (np.asarray(memory.theta) + self.length) * self.weights.length_unit

    def speed(self, memory: Traversal) -> np.ndarray:
        """Path speed decided last [m/s]; of a whole rollout too."""
        return np.asarray(memory.plan)[..., 0] * self.weights.length_unit / self.weights.period

    def _blank(self) -> QP:
        """A QP whose constant limits are set and whose other numbers are to be filled in."""
        size = self._lower.size
        return QP(
            np.empty((size, size)),
            np.empty(size),
            self._row,
            np.array([-np.inf]),
            np.empty(1),
            self._lower,
            self._upper,
        )
