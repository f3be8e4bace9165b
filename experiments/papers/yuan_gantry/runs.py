"""Runs behind Yuan's chapter 5: responses of a drive, the gantry along a path, its parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.controller import Controller
from jcontour.geometry.contours import chain, circle, line
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.references import Reference, in_time
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.linear_models import drive_response
from jcontour.plants.gantry.parameters import GantryParameters, Scalar, thesis_gantry
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import contour_error, score
from tuning.identification.estimates import Estimate
from tuning.identification.gantry.gantry import NAMES, Sheet, antiresonance, identify_gantry
from tuning.identification.gantry.gantry_commissioning import HEADS as CHIRP_HEADS
from tuning.identification.gantry.gantry_commissioning import commissioned

HEADS = (0.0, -0.66, 0.66)  # [m]; the thesis's two, and the other side of the beam
FREQUENCIES = np.geomspace(1.0, 200.0, 2001)  # [Hz]
SAMPLE = 2e-3  # [s] section 5.5, as the three below
RADIUS = 0.08  # [m]
FEED = 0.1  # [m/s]
ACCELERATION = 1.0  # [m/s^2]
UNITS = ("kg", "kg m^2", "kg", "kg m", "N s/m", "N s/m", "N m/rad")  # of what is identified
FREQUENCY = 30.0  # [rad/s] w of the follower: ours
DAMPING = 0.8  # z of the follower: ours


@dataclass(frozen=True)
class Response:
    """Fig. 5.6: frequency response from the current i_1 to the speed of its drive."""

    head_m: float  # position of the head on the beam
    coupling: bool  # whether the terms with M_e x_h are kept; (5.12) as printed has none
    antiresonance_hz: float  # of the zeros
    resonance_hz: float  # of the poles
    frequency_hz: Float[np.ndarray, " F"]
    gain_db: Float[np.ndarray, " F"]  # relative to 1 m/s per ampere
    phase_deg: Float[np.ndarray, " F"]  # without jumps


@dataclass(frozen=True)
class PathRun:
    """The gantry along Fig. 5.11; axes (time, component), SI units."""

    time_s: Float[np.ndarray, " T"]
    twist_rad: Float[np.ndarray, " T"]
    tool_m: Float[np.ndarray, "T 2"]
    wanted_m: Float[np.ndarray, "T 2"]
    contour_error_m: Float[np.ndarray, " T"]
    control_a: Float[np.ndarray, "T 3"]
    peak_twist_rad: float
    peak_contour_error_m: float
    rms_contour_error_m: float
    diverged: bool


@dataclass(frozen=True)
class Identified:
    """Section 5.2.2: a quantity of the machine, and what the identification finds."""

    name: str
    true: float
    found: float
    interval: Sequence[float]  # 95 %: from, to


class Follower(Controller):
    """A plain controller of both axes, with the same current in the two drives.

        f = M (w^2 (r - q) + 2 z w (v_r - q') + a_r) + b v_r,   M = M_e for x_h, M_t for y_N

    It has no constraints, no horizon and no model of the twist.
    """

    parameters: GantryParameters
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
        return None, jnp.stack([along / p.head_constant, drive, drive])


def responses() -> tuple[Response, ...]:
    """Fig. 5.6: from the current i_1 to the speed y_1', as printed and with the coupling kept."""
    cases = [(head, coupling) for head in HEADS for coupling in (False, True)]
    # in the middle of the beam there is no coupling
    return tuple(_response(head, kept) for head, kept in cases if head != 0 or not kept)


def _response(head: float, coupling: bool) -> Response:
    p = thesis_gantry()
    numerator, denominator = drive_response(p, head, p.head_mass * head if coupling else 0.0)
    s = 2j * np.pi * FREQUENCIES
    response = np.polyval(np.asarray(numerator), s) / np.polyval(np.asarray(denominator), s)
    return Response(
        head_m=head,
        coupling=coupling,
        antiresonance_hz=_ringing(numerator),
        resonance_hz=_ringing(denominator),
        frequency_hz=FREQUENCIES,
        gain_db=20 * np.log10(np.abs(response)),
        phase_deg=np.rad2deg(np.unwrap(np.angle(response))),
    )


def _ringing(polynomial: Float[Array, " d"]) -> float:
    """Frequency of the pair of complex roots [Hz]."""
    roots = np.roots(np.asarray(polynomial))
    return float(np.abs(roots[np.abs(roots.imag) > 0][0]) / (2 * np.pi))


def reference_path(preview: int = 1, dwell: float = 0.0) -> Reference:
    """Fig. 5.11: line, full circle, line, with a trapezoid of speed over the whole.

    Args:
        preview: samples of future to append.
        dwell: rest before and after [s].
    """
    start, corner, end = [RADIUS, -RADIUS], [RADIUS, 0.0], [RADIUS, RADIUS]
    contour = chain([line(start, corner), circle(RADIUS), line(corner, end)])
    law = PointToPoint(float(contour.length), FEED, ACCELERATION)
    duration = SAMPLE * np.ceil((law.duration + 2 * dwell) / SAMPLE)
    return in_time(contour, law, duration, SAMPLE, preview, dwell)


def along_the_path() -> PathRun:
    """Run along Fig. 5.11: twist, tool and errors."""
    p, reference = thesis_gantry(), reference_path()
    rollout = simulate(Gantry(p, SAMPLE), Follower(p), reference)
    metrics, error = score(rollout, reference), np.asarray(contour_error(rollout.output, reference))
    twist = np.asarray(rollout.state[:, 2])
    return PathRun(
        time_s=SAMPLE * np.arange(reference.steps),
        twist_rad=twist,
        tool_m=np.asarray(rollout.output),
        wanted_m=np.asarray(reference.position[: reference.steps]),
        contour_error_m=np.linalg.norm(error, axis=-1),
        control_a=np.asarray(rollout.control),
        peak_twist_rad=float(np.max(np.abs(twist))),
        peak_contour_error_m=float(metrics.peak_contour_error),
        rms_contour_error_m=float(metrics.rms_contour_error),
        diverged=bool(metrics.diverged),
    )


def identified() -> tuple[Identified, ...]:
    """Section 5.2.2 on simulated records of our machine: found beside true."""
    p, sheet = thesis_gantry(), Sheet.of(thesis_gantry())
    estimate = identify_gantry(commissioned(p, seed=0), sheet)

    def row(name: str, true: float, found: Estimate, key: str) -> Identified:
        return Identified(name, true, found[key], found.interval(key))

    rows = [
        row(f"{name.replace('_', ' ')}, {unit}", float(value), estimate, name)
        for name, unit, value in zip(NAMES, UNITS, _true_values(p), strict=True)
    ]
    for head in CHIRP_HEADS:
        found = antiresonance(estimate, sheet, head, coupled=False)
        name = f"anti-resonance by (5.12), head at {head:g} m, Hz"
        rows.append(row(name, _printed_antiresonance(p, head), found, "antiresonance"))
    return tuple(rows)


def _true_values(p: GantryParameters) -> tuple[Scalar, ...]:
    """Values of `NAMES`."""
    imbalance = (p.drive_mass_1 - p.drive_mass_2) * p.half_span
    return (
        p.total_mass,
        p.inertia(0.0),
        p.head_mass,
        imbalance,
        p.drive_viscous,
        p.head_viscous,
        p.joint_stiffness,
    )


def _printed_antiresonance(p: GantryParameters, head: float) -> float:
    """Frequency by (5.12) [Hz]."""
    inertia = p.inertia(head) + p.half_span**2 * p.total_mass
    return float(np.sqrt(2 * p.joint_stiffness / inertia) / (2 * np.pi))
