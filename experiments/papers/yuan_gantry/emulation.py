"""Runs behind Yuan's section 5.6: the path of Fig. 5.11 with a motor bench as the gantry's head."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.papers.yuan_gantry.runs import SAMPLE, Follower, reference_path
from jcontour.controller import Controller
from jcontour.controllers.wrappers.compensated import Compensated
from jcontour.motion.references import Reference
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.motor_bench.back_to_back_motors import BackToBackMotors, servo_bench
from jcontour.plants.gantry.motor_bench.delayed_head import delayed_head_model, twist_damping
from jcontour.plants.gantry.motor_bench.hardware_in_loop import HardwareInLoop
from jcontour.plants.gantry.parameters import GantryParameters, Scalar, thesis_gantry
from jcontour.simulation.closed_loop import Rollout, simulate
from jcontour.simulation.metrics import contour_error, score, tracking_error

# [N m s/rad] that the drives add to the twist: six times their friction, 3 % of the critical
DAMPED = 2000.0


@dataclass(frozen=True)
class EmulatedRun:
    """Section 5.6.4: errors along X and Y and from the contour, for one kind of head."""

    name: str  # "gantry", or the condition of the bench that stands for its head
    peak_x_error_m: float
    peak_y_error_m: float
    peak_contour_error_m: float
    rms_contour_error_m: float
    peak_twist_rad: float
    twist_rad: Float[np.ndarray, " T"]
    diverged: bool
    contour_error_m: Float[np.ndarray, " T"]
    distance_m: float  # largest, of the tool from that of the gantry
    twist_damping: float | None = None  # of a bench, without a controller [N m s/rad]
    peak_load_a: float | None = None  # current of the load motor
    peak_remainder_m_per_s: float | None = None  # F_Nx of (5.50), of a bench one sample late


@dataclass(frozen=True)
class Emulated:
    """Section 5.6: the gantry, and benches in its head's place; damping in N m s/rad."""

    time_s: Float[np.ndarray, " T"]
    added_damping: float  # of the twist, by the drives
    viscous_damping: float  # of the twist, by friction: 2 b_y L^2
    rows: tuple[EmulatedRun, ...]

    def row(self, name: str) -> EmulatedRun:
        """Run with this kind of head."""
        return next(row for row in self.rows if row.name == name)


class TwistDamping(eqx.Module):
    """Damping of the twist by the two drives: k_y L (i_2 - i_1) = -c theta'."""

    parameters: GantryParameters
    damping: Scalar  # c [N m s/rad]

    def __call__(self, state: Float[Array, "6"], control: Float[Array, "3"]) -> Float[Array, "3"]:
        """Currents to add [A]."""
        lever = 2 * self.parameters.drive_constant * self.parameters.half_span
        apart = -self.damping * state[5] / lever
        return jnp.stack([jnp.zeros_like(apart), -apart, apart])


class Case(NamedTuple):
    """The bench in one condition."""

    name: str
    delay: int  # [samples] of its currents
    dry: bool  # friction on its shaft
    damped: bool  # the twist, by the drives


CASES = (
    Case("at once, no dry friction", 0, False, True),
    Case("at once, no dry friction, undamped", 0, False, False),
    Case("at once, dry friction", 0, True, True),
    Case("late, no dry friction", 1, False, True),
    Case("late, dry friction", 1, True, True),
    Case("late, dry friction, undamped", 1, True, False),
)


def emulated() -> Emulated:
    """The gantry, and the bench in every condition, along the path."""
    p, reference = thesis_gantry(), reference_path()
    gantry = Gantry(p, SAMPLE)
    true = simulate(gantry, _controller(p, True), reference)
    rows = [_row("gantry", true, true.state, reference, distance=0.0)]
    rows += [_emulated(case, gantry, reference, true.output) for case in CASES]
    return Emulated(
        time_s=SAMPLE * np.arange(reference.steps),
        added_damping=DAMPED,
        viscous_damping=float(2 * p.drive_viscous * p.half_span**2),
        rows=tuple(rows),
    )


def _emulated(
    case: Case, gantry: Gantry, reference: Reference, wanted: Float[Array, "T 2"]
) -> EmulatedRun:
    """One condition; `wanted` is the tool of the gantry itself."""
    bench = servo_bench() if case.dry else _without_dry_friction(servo_bench())
    plant = HardwareInLoop(gantry, bench, case.delay)
    run = simulate(plant, _controller(gantry.parameters, case.damped), reference)
    row = _row(case.name, run, run.measurement, reference, _peak(run.output - wanted))
    return replace(
        row,
        twist_damping=float(twist_damping(plant)),
        peak_load_a=_peak(_load(plant, run)),
        # (5.50) is about a bench that is one sample late
        peak_remainder_m_per_s=_peak(_remainder(plant, run)) if plant.delay == 1 else None,
    )


def _controller(p: GantryParameters, damped: bool) -> Controller:
    if not damped:
        return Follower(p)
    return Compensated(Follower(p), TwistDamping(p, jnp.asarray(DAMPED)))


def _without_dry_friction(bench: BackToBackMotors) -> BackToBackMotors:
    return eqx.tree_at(
        lambda b: (b.friction.coulomb, b.friction.stribeck), bench, replace_fn=jnp.zeros_like
    )


def _row(
    name: str, run: Rollout, state: Float[Array, "T 6"], reference: Reference, distance: float
) -> EmulatedRun:
    """Errors as section 5.6.4 has them: of the tool along X and Y, and from the contour."""
    metrics = score(run, reference)
    tracking = np.abs(np.asarray(tracking_error(run.output, reference)))
    contour = np.asarray(contour_error(run.output, reference))
    return EmulatedRun(
        name=name,
        peak_x_error_m=float(tracking[:, 0].max()),
        peak_y_error_m=float(tracking[:, 1].max()),
        peak_contour_error_m=float(metrics.peak_contour_error),
        rms_contour_error_m=float(metrics.rms_contour_error),
        peak_twist_rad=_peak(state[:, 2:3]),
        twist_rad=np.asarray(state[:, 2]),
        diverged=bool(metrics.diverged),
        contour_error_m=np.linalg.norm(contour, axis=-1),
        distance_m=distance,
    )


@eqx.filter_jit
def _load(plant: HardwareInLoop, run: Rollout) -> Float[Array, "T 1"]:
    return jax.vmap(plant.load_current)(run.measurement, run.control)


@eqx.filter_jit
def _remainder(plant: HardwareInLoop, run: Rollout) -> Float[Array, "before_last 1"]:
    model = delayed_head_model(plant.gantry.parameters, plant.bench, plant.dt)
    state = jnp.column_stack(
        [run.measurement[:, 0], run.measurement[:, 3], run.state.sent[:, 0, 0]]
    )
    return (state[1:] - jax.vmap(model.step)(state, run.control[:, :1])[:-1])[:, 1:2]


def _peak(vectors: Float[Array, "T k"]) -> float:
    """Largest length of the rows."""
    return float(np.linalg.norm(np.asarray(vectors), axis=-1).max())
