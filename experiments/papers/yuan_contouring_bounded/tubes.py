"""Responses, and the tube of the machine around its nominal run, closed over its own model error.

A controller's model differs from the machine: by the coupling that it leaves out, by the place of
its linearisation. Along the run the difference of the derivatives is known, and in a tube of states
|e| <= Z and currents |du| <= V it is at most
    r = max_k |dA_k| Z + |dB_k| V
per sample, and the second-order term of its Taylor series at most

    rho = 1/2 max_k d' |H_k| d,   d = (Z, V + w).
Their sum is a disturbance beside those of the motors w. The tube grows with it, and it with the
tube: both are computed in turn, with some spare, until r covers what its own tube needs. Terms of
third order are left to that spare.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from experiments.papers.yuan_contouring_bounded.machine import DISTURBANCE, MOVING, Driven
from jcontour.plants.gantry.linear_models import Linearisation, tangent
from jcontour.sets.disturbed_model import DisturbedModel
from jcontour.sets.least_peaks import least_peak
from jcontour.sets.responses import (
    FiniteResponse,
    VaryingModel,
    VaryingResponse,
    brought_to_rest_along,
)

SPARE = 1.02  # of every peak: at the peak itself nothing is left to optimise
MARGIN = 1.05  # of the remainder: it converges geometrically
ROUNDS = 5
# [m, rad, m/s, rad/s], of second order: a first guess
GUESS = np.array([1e-10] * 3 + [1e-7] * 3)
ROUNDING = 1e-13  # of a sample in float64, in the same units
SEEN = 1e-2  # of what the motors do to a state: smaller remainders shape no pattern
ANGLES = np.pi * np.arange(4) / 4  # directions whose peaks are made small


class Part(NamedTuple):
    """States and inputs of one controller."""

    states: tuple[int, ...]
    inputs: tuple[int, ...]


@dataclass(frozen=True)
class Design:
    """One way to keep the machine in a tube.

    Attributes:
        name: for people.
        models: for people.
        linear: linear model at a head position; None for the derivative of every sample.
        points: head positions of the models.
        apart: one controller for the head and one for the beam.
        current: that the answers to disturbances may take, of head and of each drive [A].
        length: samples N of an answer.
        late: samples by which the drives act late.
        turning: what disturbances that turn within a sample may do to a state, in shares of what
            the motors' do.
    """

    name: str
    models: str
    linear: Linearisation | None
    points: tuple[float, ...]
    apart: bool
    current: tuple[float, float]
    length: int
    late: int = 0
    turning: float = 0.0

    @property
    def parts(self) -> tuple[Part, ...]:
        """States and inputs of every controller."""
        waiting = [[MOVING + 3 * j + i for j in range(self.late)] for i in range(3)]
        if self.apart:
            beam = (1, 4, 2, 5, *sorted(waiting[1] + waiting[2]))
            return Part((0, 3, *waiting[0]), (0,)), Part(beam, (1, 2))
        return (Part(tuple(range(MOVING + 3 * self.late)), (0, 1, 2)),)

    def modelled(self, machine: Driven) -> tuple[VaryingModel, Int[np.ndarray, " S"]]:
        """Models along the run, and the head position that each sample belongs to."""
        switched, which = machine.switched(self.linear or tangent, self.points)
        return (machine.exact if self.linear is None else switched), which


@dataclass(frozen=True)
class Tube:
    """A design's tube.

    Attributes:
        design: of it.
        machine: along its run.
        model: of the controllers, E that of the motors.
        responses: of every part.
        state: Z (n,), largest deviation of every state.
        current: V (3,), largest deviation of the commands [A].
        remainder: r (n,), largest model error per sample.
        closed: share of r that the tube itself needs; the tube holds where it is at most one, to
            second order and but for disturbances that turn within a sample: their box is a choice.
    """

    design: Design
    machine: Driven
    model: VaryingModel
    responses: tuple[VaryingResponse, ...]
    state: Float[np.ndarray, " n"]
    current: Float[np.ndarray, " p"]
    remainder: Float[np.ndarray, " n"]
    closed: float


def tube_of(design: Design, machine: Driven) -> Tube:
    """The tube of a design, its remainder in balance with it.

    Raises:
        NoResponse: the currents do not suffice against motors and remainder.
    """
    (model, which), curvature = design.modelled(machine), machine.curvature()
    first = _turning(design, model)
    first[:MOVING] += GUESS
    found = Tube(design, machine, model, (), np.zeros_like(first), np.zeros(3), first, np.inf)
    for _ in range(ROUNDS):
        responses = tuple(_response(found, part, which) for part in design.parts)
        state, current = _sizes(found, responses)
        needed = _needed(found, state, current)
        needed[:MOVING] += _second_order(design, curvature, state, current)
        closed = float((needed[:MOVING] / found.remainder[:MOVING]).max())
        found = replace(found, responses=responses, state=state, current=current, closed=closed)
        if closed <= 1:
            return found
        found = replace(found, remainder=MARGIN * needed)
    return found


def _turning(design: Design, model: VaryingModel) -> np.ndarray:
    """Box of the disturbances that turn within a sample (n,)."""
    return design.turning * np.abs(model.E).sum(axis=2).max(axis=0)


def _second_order(
    design: Design, curvature: np.ndarray, state: np.ndarray, current: np.ndarray
) -> np.ndarray:
    """Largest second-order term of a sample's step in a tube, and rounding (6,)."""
    acting = state[MOVING : MOVING + 3] if design.late else current  # late: those that waited
    size = np.concatenate([state[:MOVING], acting + DISTURBANCE])
    return MARGIN * (curvature @ size @ size).max(axis=0) / 2 + ROUNDING


def _sizes(tube: Tube, responses: tuple[VaryingResponse, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Z and V of all parts."""
    state, current = np.zeros_like(tube.state), np.zeros(3)
    for part, response in zip(tube.design.parts, responses, strict=True):
        R, (n, p) = response.samples, response.model.B.shape[1:]
        of_states = response.growth(_each(R, n), np.zeros((R, n, p)))[..., -1]
        of_inputs = response.growth(np.zeros((R, p, n)), _each(R, p))[..., -1]
        state[list(part.states)] = SPARE * of_states.max(axis=0)
        current[list(part.inputs)] = SPARE * of_inputs.max(axis=0)
    return state, current


def _needed(tube: Tube, state: np.ndarray, current: np.ndarray) -> np.ndarray:
    """First order of the model error, what turns, and what motors of a part do to another."""
    exact = tube.machine.exact
    apart = np.abs(exact.A - tube.model.A) @ state + np.abs(exact.B - tube.model.B) @ current
    for part in tube.design.parts:
        others = [i for i in range(3) if i not in part.inputs]
        strange = np.abs(exact.E[:, list(part.states)][:, :, others]).sum(axis=2)
        apart[:, list(part.states)] += strange
    return apart.max(axis=0) + _turning(tube.design, tube.model)


def _response(tube: Tube, part: Part, which: Int[np.ndarray, " S"]) -> VaryingResponse:
    """Responses of one part: a pattern for every head position, fitted to every sample."""
    model, motors = _of_part(tube.model, part, tube.remainder), len(part.inputs)
    design, heads = tube.design, tube.machine.run.state[: len(which), 0]
    samples = [int(np.abs(heads - point).argmin()) for point in design.points]
    tool = tube.machine.tool[:, :, list(part.states)]
    current = design.current[0] if part.inputs == (0,) else design.current[1]
    patterns = []
    for k in samples:
        rows = _tool_rows(tool[k], part)
        patterns.append(_pattern(model, k, motors, rows, current, design.length))
    return brought_to_rest_along(model, patterns, which)


def _of_part(model: VaryingModel, part: Part, remainder: np.ndarray) -> VaryingModel:
    """Rows and columns of a part; its disturbances are its motors and the remainder."""
    states, inputs = list(part.states), list(part.inputs)
    own = [place for place, state in enumerate(states) if state < MOVING]
    beside = np.diag(remainder[states])[:, own]
    E = model.E[:, states][:, :, inputs]
    E = np.concatenate([E, np.broadcast_to(beside, (len(E), *beside.shape))], axis=2)
    return VaryingModel(model.A[:, states][:, :, states], model.B[:, states][:, :, inputs], E)


def _tool_rows(tool: Float[np.ndarray, "m n"], part: Part) -> np.ndarray:
    """Directions of the tool that a part makes small: its own axis, or all around."""
    if len(part.inputs) == 3:
        return np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1) @ tool
    return tool[:1] if part.inputs == (0,) else tool[1:]


def _pattern(
    model: VaryingModel, k: int, motors: int, rows: np.ndarray, current: float, length: int
) -> FiniteResponse:
    """Least peak of the tool on the model of one sample.

    The solver's tolerances are absolute: states are in units of what the motors do to them, and a
    remainder far below that is made larger for the linear program, its answer smaller again.
    """
    A, B, E = model.A[k], model.B[k], model.E[k].copy()
    unit = np.abs(E[:, :motors]).max(axis=1)
    unit = np.where(unit > 0, unit, 1.0)
    E /= unit[:, None]
    sizes = np.ones(E.shape[1])
    sizes[motors:] = np.maximum(1.0, SEEN / np.abs(E[:, motors:]).max(axis=0))
    one = DisturbedModel.of(A * unit / unit[:, None], B / unit[:, None], E * sizes)
    wanted = rows * unit / np.abs(rows * unit).max()
    small = one.state_signals([f"tool {i + 1}" for i in range(len(rows))], wanted)
    found = least_peak(one, small, one.control_signals(current), length).response
    return replace(found, control=found.control / sizes)


def _each(samples: int, size: int) -> np.ndarray:
    return np.broadcast_to(np.eye(size), (samples, size, size))
