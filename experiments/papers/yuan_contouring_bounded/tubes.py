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

The machine's own nominal run is along Fig. 5.11. Every linear model has the states of `Gantry`, and
after them the currents that wait for a late drive.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float, Int

from experiments.papers.yuan_gantry.experiment import SAMPLE, reference_path
from jcontour import Reference
from jcontour.mpc import MachineRun, machine_run
from jcontour.plants import Gantry, thesis_gantry
from jcontour.plants.gantry.linear_models import Linearisation, currents_along, tangent
from jcontour.sets import DisturbedModel, VaryingModel, brought_to_rest_along, least_peak
from jcontour.sets.responses import FiniteResponse, VaryingResponse

POINTS = (-0.075, -0.025, 0.025, 0.075)  # [m], of linearisation, section 5.5.1
DISTURBANCE = 0.5  # [A] on every motor: ours, none is printed
DWELL = 0.02  # [s], rest at both ends
NEAR = 1e-8  # [m], error of the nominal run that counts as 1 A of current
MOVING = 6  # states of the machine itself


class Driven(NamedTuple):
    """The machine along the path."""

    reference: Reference  # with its preview
    run: MachineRun  # the machine's own, undisturbed
    late: int  # samples by which currents act late

    @property
    def exact(self) -> VaryingModel:
        """Derivative of the machine along the run; E holds the disturbance of every motor."""
        return self.modelled(self.run.A, self.run.B)

    @property
    def state(self) -> Float[np.ndarray, "S n"]:
        """Nominal states, currents that wait among them."""
        v, S = self.run.control, len(self.run.A)
        waiting = [np.concatenate([v[j:], v[-1:].repeat(j, 0)]) for j in range(self.late)]
        return np.concatenate([self.run.state[:S], *waiting], axis=1)

    @property
    def control(self) -> Float[np.ndarray, "S p"]:
        """Nominal commands: those of the drives, as much earlier as they act late."""
        v = self.run.control
        return np.concatenate([v[self.late :], v[-1:].repeat(self.late, 0)])

    @property
    def tool(self) -> Float[np.ndarray, "S m n"]:
        """Derivative of the tool."""
        C = self.run.C
        return np.concatenate([C, np.zeros((*C.shape[:2], 3 * self.late))], axis=2)

    def switched(
        self, linear: Linearisation, points: tuple[float, ...]
    ) -> tuple[VaryingModel, Int[np.ndarray, " S"]]:
        """Models at the nearest of some head positions, and which it is at every sample."""
        heads = self.run.state[: len(self.run.A), 0]
        which = np.abs(heads[:, None] - np.asarray(points)).argmin(axis=1)
        models = [linear(thesis_gantry(), point).sampled(SAMPLE) for point in points]
        A, B = (np.stack([np.asarray(one[i]) for one in models]) for i in range(2))
        return self.modelled(A[which], B[which]), which

    def modelled(self, A: np.ndarray, B: np.ndarray) -> VaryingModel:
        """Model with these matrices under the disturbances that the machine feels."""
        model = VaryingModel(A, B, DISTURBANCE * self.run.B)
        for _ in range(self.late):
            model = model.with_input_delay()
        return model


@eqx.filter_jit
def _second_derivatives(gantry: Gantry, both: np.ndarray) -> Array:
    def step(one):
        return gantry.step(one[:MOVING], one[MOVING:])

    return jax.vmap(jax.jacfwd(jax.jacfwd(step)))(both)


@cache
def driven(late: int) -> Driven:
    """The machine along the path."""
    if late:  # its own run is the same
        return driven(0)._replace(late=late)
    gantry, reference = Gantry(thesis_gantry(), SAMPLE), reference_path(2 * LENGTH, DWELL)
    currents = currents_along(gantry.parameters, reference.position, SAMPLE)
    return Driven(reference, machine_run(gantry, reference, currents, NEAR, 1.0), late)


SPARE = 1.02  # of every peak: at the peak itself nothing is left to optimise
MARGIN = 1.05  # of the remainder: it converges geometrically
ROUNDS = 5
# [m, rad, m/s, rad/s], of second order: a first guess
GUESS = np.array([1e-10] * 3 + [1e-7] * 3)
ROUNDING = 1e-13  # of a sample in float64, in the same units
LENGTH = 8  # samples N of an answer; 30 promise 1 % less
SEEN = 1e-2  # of what the motors do to a state: smaller remainders shape no pattern
ANGLES = np.pi * np.arange(4) / 4  # directions whose peaks are made small


class Part(NamedTuple):
    """States and inputs of one controller."""

    states: tuple[int, ...]
    inputs: tuple[int, ...]


@dataclass(frozen=True)
class Design:
    """One way to keep the machine in a tube."""

    name: str  # for people
    models: str  # for people
    linear: Linearisation | None  # model at a head position; None: derivative of every sample
    points: tuple[float, ...]  # head positions of the models
    apart: bool  # one controller for the head and one for the beam
    current: tuple[float, float]  # that answers may take, of head and of each drive [A]
    late: int = 0  # samples by which the drives act late
    # what disturbances that turn within a sample may do to a state, in shares of the motors'
    turning: float = 0.0

    @property
    def parts(self) -> tuple[Part, ...]:
        """States and inputs of every controller."""
        waiting = [[MOVING + 3 * j + i for j in range(self.late)] for i in range(3)]
        if self.apart:
            beam = (1, 4, 2, 5, *sorted(waiting[1] + waiting[2]))
            return Part((0, 3, *waiting[0]), (0,)), Part(beam, (1, 2))
        return (Part(tuple(range(MOVING + 3 * self.late)), (0, 1, 2)),)


@dataclass(frozen=True)
class Tube:
    """A design's tube.

    It holds where `closed` is at most one, to second order, and but for disturbances that turn
    within a sample: their box is a choice.
    """

    design: Design
    machine: Driven  # along its run
    model: VaryingModel  # of the controllers, E that of the motors
    responses: tuple[VaryingResponse, ...]  # of every part
    state: Float[np.ndarray, " n"]  # Z, largest deviation of every state
    current: Float[np.ndarray, " p"]  # V, largest deviation of the commands [A]
    remainder: Float[np.ndarray, " n"]  # r, largest model error per sample
    closed: float  # share of r that the tube itself needs


@cache
def tube(design: Design) -> Tube:
    """The tube of a design along the whole path, its remainder in balance with it."""
    machine = driven(design.late)
    model, which = machine.switched(design.linear or tangent, design.points)
    if design.linear is None:
        model = machine.exact
    run = machine.run
    both = np.concatenate([run.state[: len(run.A)], run.control], axis=1)
    # |H| (S, 6, 9, 9) of a sample's step over state and currents
    curvature = np.abs(_second_derivatives(Gantry(thesis_gantry(), SAMPLE), both))
    # box of the disturbances that turn within a sample
    turning = design.turning * np.abs(model.E).sum(axis=2).max(axis=0)
    first = turning.copy()
    first[:MOVING] += GUESS
    grown = Tube(design, machine, model, (), np.zeros_like(first), np.zeros(3), first, np.inf)
    for _ in range(ROUNDS):
        responses = tuple(_response(grown, part, which) for part in design.parts)
        state, current = _sizes(grown, responses)
        exact = machine.exact
        apart = np.abs(exact.A - model.A) @ state + np.abs(exact.B - model.B) @ current
        for part in design.parts:  # what the motors of a part do to another
            others = [i for i in range(3) if i not in part.inputs]
            strange = np.abs(exact.E[:, list(part.states)][:, :, others]).sum(axis=2)
            apart[:, list(part.states)] += strange
        needed = apart.max(axis=0) + turning
        # those that waited act where the drives are late
        acting = (state[MOVING : MOVING + 3] if design.late else current) + DISTURBANCE
        size = np.concatenate([state[:MOVING], acting])
        second_order = MARGIN * (curvature @ size @ size).max(axis=0) / 2
        needed[:MOVING] += second_order + ROUNDING
        closed = float((needed[:MOVING] / grown.remainder[:MOVING]).max())
        grown = replace(grown, responses=responses, state=state, current=current, closed=closed)
        if closed <= 1:
            return grown
        grown = replace(grown, remainder=MARGIN * needed)
    return grown


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


def _response(tube: Tube, part: Part, which: Int[np.ndarray, " S"]) -> VaryingResponse:
    """Responses of one part: a pattern for every head position, fitted to every sample."""
    states, inputs, whole = list(part.states), list(part.inputs), tube.model
    # its disturbances are its motors and the remainder
    moving = [place for place, state in enumerate(states) if state < MOVING]
    beside = np.diag(tube.remainder[states])[:, moving]
    own = whole.E[:, states][:, :, inputs]
    E = np.concatenate([own, np.broadcast_to(beside, (len(own), *beside.shape))], axis=2)
    model = VaryingModel(whole.A[:, states][:, :, states], whole.B[:, states][:, :, inputs], E)
    design, heads = tube.design, tube.machine.run.state[: len(which), 0]
    current, patterns = design.current[part.inputs != (0,)], []
    for k in (int(np.abs(heads - point).argmin()) for point in design.points):
        tool = tube.machine.tool[k, :, states].T
        if len(inputs) == 3:  # all around is made small; else the part's own axis
            rows = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1) @ tool
        else:
            rows = tool[:1] if part.inputs == (0,) else tool[1:]
        patterns.append(_pattern(model, k, len(inputs), rows, current))
    return brought_to_rest_along(model, patterns, which)


def _pattern(
    model: VaryingModel, k: int, motors: int, rows: np.ndarray, current: float
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
    response = least_peak(one, small, one.control_signals(current), LENGTH).response
    return replace(response, control=response.control / sizes)


def _each(samples: int, size: int) -> np.ndarray:
    return np.broadcast_to(np.eye(size), (samples, size, size))
