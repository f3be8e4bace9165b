"""What is computed for Yuan's chapter 5: frequency responses of a drive, and the gantry along a line, a circle and a line."""

from typing import Any

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
from jcontour.plants.gantry.parameters import GantryParameters, thesis_gantry
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import contour_error, score
from tuning.identification.gantry import NAMES, Sheet, antiresonance, identify_gantry
from tuning.identification.gantry_commissioning import HEADS as CHIRP_HEADS
from tuning.identification.gantry_commissioning import commissioned

HEADS = (0.0, -0.66, 0.66)  # [m]; the thesis's two, and the other side of the beam
FREQUENCIES = np.geomspace(1.0, 200.0, 2001)  # [Hz]
SAMPLE, RADIUS, FEED, ACCELERATION = 2e-3, 0.08, 0.1, 1.0  # section 5.5
UNITS = ("kg", "kg m^2", "kg", "kg m", "N s/m", "N s/m", "N m/rad")  # of what is identified
FREQUENCY, DAMPING = 30.0, 0.8  # [rad/s] of the follower: ours


class Follower(Controller):
    """Both axes pulled to where they should be, the two drives with the same current: no set, no horizon, no knowledge of the twist.

    f = M (w^2 (r - q) + 2 z w (v_r - q') + a_r) + b v_r with M = M_e for x_h and M_t for y_N.
    """

    parameters: GantryParameters
    preview: int = eqx.field(static=True, default=1)

    def prepare(self, reference: Reference) -> tuple[Float[Array, "T 2"], ...]:
        """Where the head and the beam should be [m], how fast they should move [m/s] and gather speed [m/s^2]."""
        wanted = reference.position.at[:, 1].add(self.parameters.tool_offset)
        speed = jnp.diff(wanted, axis=0)[: reference.steps] / reference.dt
        return (
            wanted[: reference.steps],
            speed,
            jnp.diff(speed, axis=0, prepend=jnp.zeros((1, 2))) / reference.dt,
        )

    def initial_memory(self, reference: Reference) -> None:
        """None: the law is static."""
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


def responses() -> list[dict[str, Any]]:
    """Fig. 5.6: from the current i_1 to the speed y_1', as printed and with the coupling M_e x_h kept."""
    p, rows = thesis_gantry(), []
    for head in HEADS:
        for coupling in (False, True):
            if head == 0 and coupling:
                continue  # there is none
            numerator, denominator = drive_response(
                p, head, p.head_mass * head if coupling else 0.0
            )
            s = 2j * np.pi * FREQUENCIES
            response = np.polyval(np.asarray(numerator), s) / np.polyval(np.asarray(denominator), s)
            rows.append(
                {
                    "head_m": head,
                    "coupling": coupling,
                    "antiresonance_hz": _ringing(numerator),
                    "resonance_hz": _ringing(denominator),
                    "frequency_hz": FREQUENCIES,
                    "gain_db": 20 * np.log10(np.abs(response)),
                    "phase_deg": np.rad2deg(np.unwrap(np.angle(response))),
                }
            )
    return rows


def _ringing(polynomial) -> float:
    """Frequency of the pair of complex roots [Hz]."""
    roots = np.roots(np.asarray(polynomial))
    return float(np.abs(roots[np.abs(roots.imag) > 0][0]) / (2 * np.pi))


def reference_path() -> Reference:
    """Fig. 5.11: line, full circle, line, with a trapezoid of speed over the whole."""
    start, corner, end = [RADIUS, -RADIUS], [RADIUS, 0.0], [RADIUS, RADIUS]
    contour = chain([line(start, corner), circle(RADIUS), line(corner, end)])
    law = PointToPoint(float(contour.length), FEED, ACCELERATION)
    return in_time(contour, law, SAMPLE * np.ceil(law.duration / SAMPLE), SAMPLE)


def along_the_path() -> dict[str, Any]:
    """The run along Fig. 5.11: twist, tool and errors."""
    p, reference = thesis_gantry(), reference_path()
    rollout = simulate(Gantry(p, SAMPLE), Follower(p), reference)
    metrics, error = score(rollout, reference), np.asarray(contour_error(rollout.output, reference))
    return {
        "time_s": SAMPLE * np.arange(reference.steps),
        "twist_rad": rollout.state[:, 2],
        "tool_m": rollout.output,
        "wanted_m": reference.position[: reference.steps],
        "contour_error_m": np.linalg.norm(error, axis=-1),
        "control_a": rollout.control,
        "peak_twist_rad": float(jnp.max(jnp.abs(rollout.state[:, 2]))),
        "peak_contour_error_m": float(metrics.peak_contour_error),
        "rms_contour_error_m": float(metrics.rms_contour_error),
        "diverged": bool(metrics.diverged),
    }


def identified() -> list[dict[str, Any]]:
    """Section 5.2.2 on records of our machine: what the identification finds, and what is true."""
    p, sheet = thesis_gantry(), Sheet.of(thesis_gantry())
    estimate = identify_gantry(commissioned(p, seed=0), sheet)
    imbalance = (p.drive_mass_1 - p.drive_mass_2) * p.half_span
    true = (
        p.total_mass,
        p.inertia(0.0),
        p.head_mass,
        imbalance,
        p.drive_viscous,
        p.head_viscous,
        p.joint_stiffness,
    )
    rows = [
        _found(f"{name}, {unit}", value, estimate, name)
        for name, unit, value in zip(NAMES, UNITS, true, strict=True)
    ]
    for head in CHIRP_HEADS:
        printed = np.sqrt(
            2 * p.joint_stiffness / (p.inertia(head) + p.half_span**2 * p.total_mass)
        ) / (2 * np.pi)
        found = antiresonance(estimate, sheet, head, coupled=False)
        rows.append(
            _found(
                f"anti-resonance by (5.12), head at {head:g} m, Hz", printed, found, "antiresonance"
            )
        )
    return rows


def _found(name: str, true, estimate, key: str) -> dict[str, Any]:
    return {
        "name": name.replace("_", " "),
        "true": float(true),
        "found": estimate[key],
        "interval": estimate.interval(key),
    }
