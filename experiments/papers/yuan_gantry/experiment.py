"""Yuan 2020, sections 5.1, 5.2, 5.5 and 5.6: a dual-drive gantry and its emulated head.

Its resonances, its twist along a path, its head emulated by a motor bench, and three engines.
Hardly a mass or a stiffness of the machine is printed. Ours solve (5.12) for the two
anti-resonances that are. These two are therefore an input of the model, and everything else
follows from it. A plain follower drives the path; the thesis's set-based controllers are those of
`yuan_contouring_bounded`.
"""

from dataclasses import dataclass, replace
from itertools import product

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.benchmarks.gantry import engine_differences
from experiments.papers import THESIS
from experiments.papers.yuan_gantry.motor_bench import (
    HardwareInLoop,
    MotorBench,
    delayed_head_model,
    twist_damping,
)
from experiments.tables import where
from jcontour import Controller, Reference, score, simulate
from jcontour.geometry.contours import chain, circle, line
from jcontour.motion import PointToPoint, in_time
from jcontour.plants import Gantry, GantryParameters, thesis_gantry
from jcontour.plants.gantry.linear_models import drive_response
from jcontour.simulation.closed_loop import Rollout
from jcontour.simulation.metrics import contour_error, tracking_error

SOURCE = f"{THESIS}, ch. 5"
HEADS = (0.0, -0.66, 0.66)  # [m]; the thesis's two, and the other side of the beam
FREQUENCIES = np.geomspace(1.0, 200.0, 2001)  # [Hz]
SAMPLE = 2e-3  # [s] section 5.5, as the three below
RADIUS = 0.08  # [m]
FEED = 0.1  # [m/s]
ACCELERATION = 1.0  # [m/s^2]
FREQUENCY = 30.0  # [rad/s] w of the follower: ours
DAMPING = 0.8  # z of the follower: ours
# [N m s/rad] that the drives add to the twist: six times their friction, 3 % of the critical
DAMPED = 2000.0


@dataclass(frozen=True)
class Response:
    """Fig. 5.6: frequency response from the current i_1 to the speed of its drive."""

    head_m: float  # position of the head on the beam
    coupling: bool  # whether the terms with M_e x_h are kept; (5.12) as printed has none
    antiresonance_hz: float  # of the zeros
    frequency_hz: Float[np.ndarray, " F"]
    gain_db: Float[np.ndarray, " F"]  # relative to 1 m/s per ampere
    phase_deg: Float[np.ndarray, " F"]  # without jumps


@dataclass(frozen=True)
class HeadRun:
    """Section 5.6.4: errors along X and Y and from the contour, for one kind of head."""

    name: str  # "gantry", or the condition of the bench that stands for its head
    peak_x_error_m: float
    peak_y_error_m: float
    peak_contour_error_m: float
    peak_twist_rad: float
    twist_rad: Float[np.ndarray, " T"]
    tool_m: Float[np.ndarray, "T 2"]
    diverged: bool
    contour_error_m: Float[np.ndarray, " T"]
    distance_m: float  # largest, of the tool from that of the gantry
    twist_damping: float | None = None  # of a bench, without a controller [N m s/rad]
    peak_remainder_m_per_s: float | None = None  # F_Nx of (5.50), of a bench one sample late


@dataclass(frozen=True)
class Result:
    """Resonances, the path, the emulated head, and three engines."""

    responses: tuple[Response, ...]
    path: HeadRun
    heads: tuple[HeadRun, ...]  # the gantry, and benches in its head's place
    engines: dict[str, float]  # largest difference to our model in a step, relative

    def response(self, head: float, coupling: bool) -> Response:
        """Response for a position of the head [m]."""
        return where(self.responses, head_m=head, coupling=coupling)[0]

    def head(self, name: str) -> HeadRun:
        """Run with this kind of head."""
        return where(self.heads, name=name)[0]


def run(quick: bool = False) -> Result:
    """Compute everything."""
    return Result(responses(), along_the_path(), emulated(), engine_differences())


class Follower(Controller):
    """A plain controller of both axes, with the same current in the two drives.

        f = M (w^2 (r - q) + 2 z w (v_r - q') + a_r) + b v_r,   M = M_e for x_h, M_t for y_N

    It has no constraints, no horizon and no model of the twist, which the two drives may damp:

        k_y L (i_2 - i_1) = -c theta'
    """

    parameters: GantryParameters
    damping: float = eqx.field(static=True, default=0.0)  # c [N m s/rad]
    preview: int = eqx.field(static=True, default=1)

    def prepare(self, reference: Reference) -> tuple[Float[Array, "T 2"], ...]:
        """Desired position [m], speed [m/s] and acceleration [m/s^2] of head and beam."""
        wanted = reference.position.at[:, 1].add(self.parameters.tool_offset)
        speed = jnp.diff(wanted, axis=0)[: reference.steps] / reference.dt
        acceleration = jnp.diff(speed, axis=0, prepend=jnp.zeros((1, 2))) / reference.dt
        return wanted[: reference.steps], speed, acceleration

    def initial_memory(self, reference: Reference) -> None:
        """No memory: the controller is static."""
        return None

    def step(
        self, memory: None, plan, measurement: Float[Array, "6"]
    ) -> tuple[None, Float[Array, "3"]]:
        """Currents of the head and the two drives [A]."""
        p, (position, speed, acceleration) = self.parameters, plan
        pull = (
            FREQUENCY**2 * (position - measurement[:2])
            + 2 * DAMPING * FREQUENCY * (speed - measurement[3:5])
            + acceleration
        )
        along = p.head_mass * pull[0] + p.head_viscous * speed[0]
        across = p.total_mass * pull[1] + 2 * p.drive_viscous * speed[1]
        drive = across / (2 * p.drive_constant)
        apart = -self.damping * measurement[5] / (2 * p.drive_constant * p.half_span)
        return None, jnp.stack([along / p.head_constant, drive - apart, drive + apart])


def responses() -> tuple[Response, ...]:
    """Fig. 5.6: from the current i_1 to the speed y_1', as printed and with the coupling kept."""
    p, s, rows = thesis_gantry(), 2j * np.pi * FREQUENCIES, []
    for head, coupling in product(HEADS, (False, True)):
        if coupling and head == 0:
            continue  # in the middle of the beam there is none
        moment = p.head_mass * head if coupling else 0.0
        above, below = (np.asarray(one) for one in drive_response(p, head, moment))
        response, zeros = np.polyval(above, s) / np.polyval(below, s), np.roots(above)
        ringing = np.abs(zeros[np.abs(zeros.imag) > 0][0]) / (2 * np.pi)
        gain, phase = 20 * np.log10(np.abs(response)), np.rad2deg(np.unwrap(np.angle(response)))
        rows.append(Response(head, coupling, float(ringing), FREQUENCIES, gain, phase))
    return tuple(rows)


def reference_path(preview: int = 1, dwell: float = 0.0) -> Reference:
    """Fig. 5.11: line, full circle, line, with a trapezoid of speed; rest [s] before and after."""
    start, corner, end = [RADIUS, -RADIUS], [RADIUS, 0.0], [RADIUS, RADIUS]
    contour = chain([line(start, corner), circle(RADIUS), line(corner, end)])
    law = PointToPoint(float(contour.length), FEED, ACCELERATION)
    duration = SAMPLE * np.ceil((law.duration + 2 * dwell) / SAMPLE)
    return in_time(contour, law, duration, SAMPLE, preview, dwell)


def along_the_path() -> HeadRun:
    """Run along Fig. 5.11 by the follower alone: twist, tool and errors."""
    p, reference = thesis_gantry(), reference_path()
    run = simulate(Gantry(p, SAMPLE), Follower(p), reference)
    return _row("gantry, drives alike", run, run.state, reference, distance=0.0)


CASES = {  # delay of its currents [samples], friction on its shaft, twist damped by the drives
    "at once, no dry friction": (0, False, True),
    "at once, no dry friction, undamped": (0, False, False),
    "at once, dry friction": (0, True, True),
    "late, no dry friction": (1, False, True),
    "late, dry friction": (1, True, True),
    "late, dry friction, undamped": (1, True, False),
}


def emulated() -> tuple[HeadRun, ...]:
    """The gantry, and the bench in every condition, along the path."""
    p, reference = thesis_gantry(), reference_path()
    gantry = Gantry(p, SAMPLE)
    true = simulate(gantry, Follower(parameters=p, damping=DAMPED), reference)
    rows = [_row("gantry", true, true.state, reference, distance=0.0)]
    for name, (delay, dry, damped) in CASES.items():
        plant = HardwareInLoop(gantry=gantry, bench=MotorBench(dry), delay=delay)
        run = simulate(plant, Follower(parameters=p, damping=DAMPED * damped), reference)
        away = _peak(run.output - true.output)
        row = replace(
            _row(name, run, run.measurement, reference, away),
            twist_damping=float(twist_damping(plant)),
            # (5.50) is about a bench that is one sample late
            peak_remainder_m_per_s=_peak(_remainder(plant, run)) if plant.delay == 1 else None,
        )
        rows.append(row)
    return tuple(rows)


def _row(
    name: str, run: Rollout, state: Float[Array, "T 6"], reference: Reference, distance: float
) -> HeadRun:
    """Errors as section 5.6.4 has them: of the tool along X and Y, and from the contour."""
    metrics, twist = score(run, reference), np.asarray(state[:, 2])
    tracking = np.abs(np.asarray(tracking_error(run.output, reference))).max(axis=0)
    contour = np.linalg.norm(np.asarray(contour_error(run.output, reference)), axis=-1)
    return HeadRun(
        name,
        *map(float, (*tracking, metrics.peak_contour_error, np.abs(twist).max())),
        twist_rad=twist,
        tool_m=np.asarray(run.output),
        diverged=bool(metrics.diverged),
        contour_error_m=contour,
        distance_m=distance,
    )


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
