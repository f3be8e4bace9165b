"""Yuan 2020, sections 5.3 to 5.5: a gantry's contour error kept within a tolerance.

The two contouring controllers of the thesis, by bounded tracking errors (CEBC-1) and by the contour
error itself (CEBC-2), along Fig. 5.11. As printed they constrain the nominal prediction only. Here
every limit is tightened by what disturbances can do, over all switches of the model.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments.papers import THESIS
from experiments.papers.yuan_contouring_bounded.controllers import (
    attack,
    controller,
    random_forces,
)
from experiments.papers.yuan_contouring_bounded.tubes import (
    MOVING,
    POINTS,
    Design,
    Tube,
    tube,
)
from experiments.papers.yuan_gantry.experiment import RADIUS, SAMPLE
from experiments.tables import where
from jcontour import Plant, score
from jcontour.app.machines.gantry import guide_ways
from jcontour.host import reported_loop
from jcontour.plants import Delayed, Disturbed, Gantry, StickSlipGantry, thesis_gantry
from jcontour.plants.gantry.linear_models import control_oriented, tangent
from jcontour.plants.gantry.mujoco_engine import GantryMuJoCo
from jcontour.simulation.metrics import contour_error, tracking_error

SOURCE = f"{THESIS}, sections 5.3 to 5.5"
CEBC1, CEBC2 = "CEBC-1", "CEBC-2"  # by bounded tracking errors; by the contour error itself
ATTACKED, RANDOM, FRICTION = "worst", "random", "friction"  # what acts, the first two 0.5 A
GANTRY, TWIN, GUIDES = "gantry", "MuJoCo", "guides"  # smooth; smooth; with stick and slip
EVERY, FOUR, ONE = "every sample", "four places", "one place"  # where models are taken
TOLERANCE = 4e-3  # [m] of the thesis
PRINTED_SIDES = 10  # of the outer polygon
# [A] for answers to disturbances, of head and drives: little above what there is an answer with
TRACKED = Design(CEBC1, FOUR, control_oriented, POINTS, True, (4.0, 2.2))
LATE_TRACKED = Design(CEBC1, FOUR, control_oriented, POINTS, True, (9.0, 5.0), late=1)
SWITCHED = Design(CEBC2, FOUR, tangent, POINTS, False, (1.5, 1.5))
CENTRED = Design(CEBC2, ONE, tangent, (0.0,), False, (1.5, 1.5))
EXACT = Design(CEBC2, EVERY, None, POINTS, False, (1.5, 1.5))
LATE_EXACT = Design(CEBC2, EVERY, None, POINTS, False, (3.0, 3.0), late=1)
RUBBED = Design(CEBC2, EVERY, None, POINTS, False, (2.0, 2.0), turning=0.12)
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
QUICK_STEPS = 700  # of 3,384: the first line and a tenth of the circle


@dataclass(frozen=True)
class LoopRow:
    """Run of a controller along Fig. 5.11: largest values, promised and reached."""

    name: str
    models: str
    machine: str
    acting: str  # what disturbs the machine
    states: int  # of the model, currents that wait for a late drive among them
    promised_um: float  # contour error that the certificate allows
    reached_um: float
    promised_axes_um: tuple[float, float] | None  # tracking errors along X and Y; None: not kept
    reached_axes_um: tuple[float, float]
    promised_twist_urad: float
    reached_twist_urad: float
    closed: float  # share of the model error's box that the tube needs, to second order
    motor_share: float  # disturbance of a motor over its box
    remainder_share: float  # model error over its box
    current_a: float
    unsolved: int  # QPs without an answer
    median_ms: float  # processor time of a step of all controllers, building and solving
    samples: int
    diverged: bool
    contour_error_um: Float[np.ndarray, " T"]

    @property
    def late(self) -> bool:
        """Whether the drives act one sample late."""
        return self.states > 6

    @property
    def label(self) -> str:
        """The controller and its models."""
        return f"{self.name}, {self.models}"

    @property
    def place(self) -> str:
        """The machine and what acts on it."""
        return f"{self.machine}{' late' * self.late}, {self.acting}"

    @property
    def kept(self) -> bool:
        """Whether the run stayed within its promise, every QP solved, the tube closed."""
        within = self.reached_um <= self.promised_um and not self.diverged
        return within and self.unsolved == 0 and self.closed <= 1


@dataclass(frozen=True)
class Result:
    """Algorithm 2 and the runs of all controllers."""

    sides: tuple[int, int]  # n_in and n_out of Algorithm 2 for R = 80 mm and 4 mm
    printed_side_mm: float  # l_side of the outer polygon with the 10 sides that are printed
    loops: tuple[LoopRow, ...]

    def loop(self, name: str, models: str, late: bool = False) -> LoopRow | None:
        """The run of a controller on the library's gantry; None where a quick run has none."""
        wanted = {"machine": GANTRY, "acting": ATTACKED, "late": late}
        return next(iter(where(self.loops, name=name, models=models, **wanted)), None)


def run(quick: bool = False) -> Result:
    """Compute everything."""
    rows = [ROWS[i] for i in QUICK] if quick else ROWS
    steps = QUICK_STEPS if quick else None
    printed = 1e3 * (RADIUS + TOLERANCE) * np.cos(np.pi / PRINTED_SIDES)
    sides = ring_polygons(RADIUS, TOLERANCE)[:2]
    return Result(sides, float(printed), tuple(loop_row(*row, steps) for row in rows))


def ring_polygons(radius: float, tolerance: float) -> tuple[int, int, float, float]:
    """Sides n_in, n_out of the polygons of Algorithm 2 with l_vert <= R <= l_side, and these.

    The tool may be anywhere between the radii R - eps and R + eps. The vertices of the polygon
    around the inner circle are at l_vert = (R - eps) / cos(pi / n_in) from the centre, the sides of
    that inside the outer circle at l_side = (R + eps) cos(pi / n_out).
    """
    inner, outer = 3, 3
    while (radius - tolerance) / np.cos(np.pi / inner) > radius:
        inner += 1
    vertex = (radius - tolerance) / np.cos(np.pi / inner)
    # (5.42), and line 5: the circle lies inside
    while (radius + tolerance) * np.cos(np.pi / outer) < max(vertex, radius):
        outer += 1
    return inner, outer, vertex, (radius + tolerance) * np.cos(np.pi / outer)


def loop_row(design: Design, machine: str, acting: str, steps: int | None) -> LoopRow:
    """A controller along the path, or its first steps."""
    kept = tube(design)
    whole, promise = controller(kept)
    reference = kept.machine.reference
    reference = reference if steps is None else reference.first(steps)
    force = None if acting == FRICTION else random_forces(reference.steps)
    if acting == ATTACKED:
        force = attack(kept, whole, reference.steps)
    parameters = thesis_gantry()
    if machine == GUIDES:
        plant: Plant = StickSlipGantry(parameters, guide_ways(), SAMPLE)
    else:
        plant = {GANTRY: Gantry, TWIN: GantryMuJoCo}[machine](parameters, SAMPLE)
    if force is not None:
        plant = Disturbed(plant, force=jnp.asarray(force))
    if design.late:
        plant = Delayed(plant, jnp.asarray(design.late), design.late, 3)
    reported_loop(plant, whole, reference.first(1))  # no time of a step is that of the first use
    whole.seconds.clear()
    run = reported_loop(plant, whole, reference, fallback="hold")
    rollout, axes, times = run.rollout, promise.axes, whole.seconds
    contour = np.linalg.norm(np.asarray(contour_error(rollout.output, reference)), axis=1)
    tracked = np.abs(np.asarray(tracking_error(rollout.output, reference))).max(axis=0)
    motors, remainder = _in_boxes(kept, rollout.measurement, rollout.control, force)
    return LoopRow(
        name=design.name,
        models=design.models,
        machine=machine,
        acting=acting,
        states=MOVING + 3 * design.late,
        promised_um=1e6 * promise.contour,
        reached_um=1e6 * float(contour.max()),
        promised_axes_um=None if axes is None else (1e6 * axes[0], 1e6 * axes[1]),
        reached_axes_um=(1e6 * float(tracked[0]), 1e6 * float(tracked[1])),
        promised_twist_urad=1e6 * promise.twist,
        reached_twist_urad=1e6 * float(np.abs(np.asarray(rollout.measurement)[:, 2]).max()),
        closed=kept.closed,
        motor_share=motors,
        remainder_share=remainder,
        current_a=float(np.abs(np.asarray(rollout.control)).max()),
        unsolved=run.report.fallbacks,
        median_ms=1e3 * float(np.median(times)),
        samples=reference.steps,
        diverged=bool(score(rollout, reference).diverged),
        contour_error_um=1e6 * contour,
    )


def _in_boxes(kept: Tube, states, controls, force: np.ndarray | None) -> tuple[float, float]:
    """Largest motor disturbance and model error over their boxes; motors explain what they can."""
    x, u = np.asarray(states), np.asarray(controls)
    machine, late, T = kept.machine, kept.design.late, len(u)
    acting = np.concatenate([np.zeros((late, 3)), u])[:T]  # a late drive acts on the one before
    model = kept.model
    A, B = model.A[: T - 1, :MOVING, :MOVING], model.B[: T - 1, :MOVING]
    if late:  # columns of the currents that arrive
        B = model.A[: T - 1, :MOVING, MOVING : MOVING + 3]
    e, du = x - machine.run.state[:T], acting - machine.run.control[:T]
    rest = e[1:] - np.einsum("kij,kj->ki", A, e[:-1]) - np.einsum("kij,kj->ki", B, du[:-1])
    E = model.E[: T - 1, :MOVING]
    if force is None:
        units = np.abs(E).max(axis=2, keepdims=True)
        shares = np.einsum("kij,kj->ki", np.linalg.pinv(E / units), rest / units[..., 0])
    else:
        shares = force[: T - 1] / np.abs(force).max()
    own = np.zeros_like(rest)
    for part in kept.design.parts:  # what a part's motors do to another is its model error
        states, inputs = [i for i in part.states if i < MOVING], list(part.inputs)
        own[:, states] += np.einsum("kij,kj->ki", E[:, states][:, :, inputs], shares[:, inputs])
    error = np.abs(rest - own) / kept.remainder[:MOVING]
    return float(np.abs(shares).max()), float(error.max())
