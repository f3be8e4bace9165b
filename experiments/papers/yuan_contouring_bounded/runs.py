"""Computations behind the contouring controllers: designs, closed loops under attack, polygons."""

from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments.papers.yuan_contouring_bounded.controllers import (
    Promise,
    attack,
    controller,
    random_forces,
)
from experiments.papers.yuan_contouring_bounded.machine import MOVING, POINTS, driven
from experiments.papers.yuan_contouring_bounded.result import (
    ATTACKED,
    CEBC1,
    CEBC2,
    EVERY,
    FOUR,
    FRICTION,
    GANTRY,
    GUIDES,
    ONE,
    RANDOM,
    TWIN,
    LoopRow,
    Polygons,
)
from experiments.papers.yuan_contouring_bounded.timed import Timed, seconds
from experiments.papers.yuan_contouring_bounded.tubes import Design, Tube, tube_of
from experiments.papers.yuan_gantry.runs import RADIUS, SAMPLE
from jcontour.app.machines.gantry import guide_ways
from jcontour.host.loop import HostRun, reported_loop
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.plants.gantry.engines.mujoco_engine import GantryMuJoCo
from jcontour.plants.gantry.friction_gantry import StickSlipGantry
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.linear_models import control_oriented, tangent
from jcontour.plants.gantry.parameters import thesis_gantry
from jcontour.plants.wrappers.delays import Delayed
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.sets.ring_polygons import ring_polygons
from jcontour.simulation.metrics import contour_error, score, tracking_error

TOLERANCE = 4e-3  # [m] of the thesis
PRINTED_SIDES = 10  # of the outer polygon
LENGTH = 8  # samples of an answer; 30 promise 1 % less
# [A] for answers to disturbances, of head and drives: little above what there is an answer with
TRACKED = Design(CEBC1, FOUR, control_oriented, POINTS, True, (4.0, 2.2), LENGTH)
LATE_TRACKED = Design(CEBC1, FOUR, control_oriented, POINTS, True, (9.0, 5.0), LENGTH, late=1)
SWITCHED = Design(CEBC2, FOUR, tangent, POINTS, False, (1.5, 1.5), LENGTH)
CENTRED = Design(CEBC2, ONE, tangent, (0.0,), False, (1.5, 1.5), LENGTH)
EXACT = Design(CEBC2, EVERY, None, POINTS, False, (1.5, 1.5), LENGTH)
LATE_EXACT = Design(CEBC2, EVERY, None, POINTS, False, (3.0, 3.0), LENGTH, late=1)
RUBBED = Design(CEBC2, EVERY, None, POINTS, False, (2.0, 2.0), LENGTH, turning=0.12)
ROWS = (
    (TRACKED, GANTRY, ATTACKED),
    (TRACKED, TWIN, ATTACKED),
    (CENTRED, GANTRY, ATTACKED),
    (SWITCHED, GANTRY, ATTACKED),
    (EXACT, GANTRY, ATTACKED),
    (EXACT, GANTRY, RANDOM),
    (EXACT, TWIN, ATTACKED),
    (RUBBED, GUIDES, FRICTION),
    (LATE_TRACKED, GANTRY, ATTACKED),
    (LATE_EXACT, GANTRY, ATTACKED),
)
QUICK = (0, 4, 6, 9)  # rows of a quick run


def polygons() -> Polygons:
    """Algorithm 2, and the outer polygon that is printed."""
    found = ring_polygons(RADIUS, TOLERANCE)
    printed = (RADIUS + TOLERANCE) * np.cos(np.pi / PRINTED_SIDES)
    lengths = (1e3 * float(one) for one in (printed, found.side, RADIUS))
    return Polygons(found.inner, found.outer, *lengths)


@cache
def tube(design: Design) -> Tube:
    """Tube of a design along the whole path."""
    return tube_of(design, driven(2 * design.length, design.late))


def loop_row(design: Design, machine: str, acting: str, steps: int | None) -> LoopRow:
    """A controller along the path, or its first steps."""
    found = tube(design)
    whole, promise = controller(found)
    reference = found.machine.reference
    reference = reference if steps is None else reference.first(steps)
    force = None if acting == FRICTION else random_forces(reference.steps)
    if acting == ATTACKED:
        force = attack(found, whole, reference.steps)
    plant = _plant(design, machine, force)
    reported_loop(plant, whole, reference.first(1))  # no time of a step is that of the first use
    run = reported_loop(plant, Timed(whole), reference, fallback="hold")
    return _row(_Seen(found, reference, machine, acting, force), promise, run)


def _plant(design: Design, machine: str, force: np.ndarray | None) -> Plant:
    parameters = thesis_gantry()
    if machine == GUIDES:
        plant: Plant = StickSlipGantry(parameters, guide_ways(), SAMPLE)
    else:
        plant = {GANTRY: Gantry, TWIN: GantryMuJoCo}[machine](parameters, SAMPLE)
    if force is not None:
        plant = Disturbed(plant, force=jnp.asarray(force))
    return Delayed(plant, jnp.asarray(design.late), design.late, 3) if design.late else plant


class _Seen(NamedTuple):
    """A run's circumstances."""

    tube: Tube
    reference: Reference
    machine: str
    acting: str
    force: np.ndarray | None


def _row(seen: _Seen, promise: Promise, run: HostRun) -> LoopRow:
    rollout, design, reference = run.rollout, seen.tube.design, seen.reference
    contour = np.linalg.norm(np.asarray(contour_error(rollout.output, reference)), axis=1)
    tracked = np.abs(np.asarray(tracking_error(rollout.output, reference))).max(axis=0)
    motors, remainder = _in_boxes(seen.tube, rollout.measurement, rollout.control, seen.force)
    axes, times = promise.axes, seconds(rollout)
    return LoopRow(
        name=design.name,
        models=design.models,
        machine=seen.machine,
        acting=seen.acting,
        states=MOVING + 3 * design.late,
        length=design.length,
        promised_um=1e6 * promise.contour,
        reached_um=1e6 * float(contour.max()),
        promised_axes_um=None if axes is None else (1e6 * axes[0], 1e6 * axes[1]),
        reached_axes_um=(1e6 * float(tracked[0]), 1e6 * float(tracked[1])),
        promised_twist_urad=1e6 * promise.twist,
        reached_twist_urad=1e6 * float(np.abs(np.asarray(rollout.measurement)[:, 2]).max()),
        remainder_a=_as_current(seen.tube),
        closed=seen.tube.closed,
        motor_share=motors,
        remainder_share=remainder,
        current_a=float(np.abs(np.asarray(rollout.control)).max()),
        active=run.report.active_fraction,
        unsolved=run.report.fallbacks,
        median_ms=1e3 * float(np.median(times)),
        slowest_ms=1e3 * float(times.max()),
        samples=reference.steps,
        diverged=bool(score(rollout, reference).diverged),
        contour_error_um=1e6 * contour,
    )


def _as_current(found: Tube) -> float:
    """The remainder in units of what 1 A does to the same state, where that is most."""
    run = found.machine.run
    by_motors = np.abs(run.B[:, 3:]).max(axis=(0, 2))  # speeds alone: positions follow them
    return float((found.remainder[3:MOVING] / by_motors).max())


def _in_boxes(found: Tube, states, controls, force: np.ndarray | None) -> tuple[float, float]:
    """Largest disturbance of a motor, and largest model error, over their boxes.

    Under an unknown force the motors explain as much as they can.
    """
    x, u = np.asarray(states), np.asarray(controls)
    machine, late, T = found.machine, found.design.late, len(u)
    acting = np.concatenate([np.zeros((late, 3)), u])[:T]  # a late drive acts on the one before
    model = found.model
    A, B = model.A[: T - 1, :MOVING, :MOVING], _acting_columns(found)[: T - 1]
    e, du = x - machine.run.state[:T], acting - machine.run.control[:T]
    rest = e[1:] - _times(A, e[:-1]) - _times(B, du[:-1])
    E = model.E[: T - 1, :MOVING]
    if force is None:
        units = np.abs(E).max(axis=2, keepdims=True)
        shares = _times(np.linalg.pinv(E / units), rest / units[..., 0])
    else:
        shares = force[: T - 1] / np.abs(force).max()
    own = np.zeros_like(rest)
    for part in found.design.parts:  # what a part's motors do to another is its model error
        states, inputs = [i for i in part.states if i < MOVING], list(part.inputs)
        own[:, states] += _times(E[:, states][:, :, inputs], shares[:, inputs])
    error = np.abs(rest - own) / found.remainder[:MOVING]
    return float(np.abs(shares).max()), float(error.max())


def _acting_columns(found: Tube) -> Float[np.ndarray, "S n p"]:
    """Columns of the acting currents: the model's change of the machine's states in a sample."""
    if found.design.late:
        return found.model.A[:, :MOVING, MOVING : MOVING + 3]
    return found.model.B


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.einsum("kij,kj->ki", matrices, vectors)
