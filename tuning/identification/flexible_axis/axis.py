"""A flexible axis from the records of its commissioning: every parameter with its interval.

The order is that of Yuan, section 3.3: the winding gives k_e and with it the force scale k_t = 3/2
k_e; the link between motor and end effector follows from their two positions alone; one balance of
forces over all sliding motion gives masses, friction and cogging.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from jcontour.plants.flexible_axis.axis import AxisParameters
from jcontour.plants.friction import Friction
from tuning.identification.estimates import Estimate, joined
from tuning.identification.flexible_axis.forces import ForceFit, fit_forces
from tuning.identification.flexible_axis.link import LinkFit, fit_link
from tuning.identification.flexible_axis.records import Record, electrical, mechanical, with_tool
from tuning.identification.flexible_axis.separability import notes, stribeck_separated
from tuning.identification.flexible_axis.slides import WINDOW
from tuning.identification.flexible_axis.winding import WindingFit, fit_winding

# periods of the link in one window of the force balance: the vibration has to show in it
PASSED = 0.9
LIGHT = 1e-3  # of the total mass
NOT_FORCES = ("curvature", "pole_pitch")  # of the balance: what does not depend on the force scale


@dataclass(frozen=True)
class IdentifiedAxis:
    """An axis as its data show it.

    Attributes:
        estimate: every parameter under its name in `AxisParameters`, `Friction` and `LinearMotor`;
            beside them total_mass, break_away (f_c + f_s), stiffness_per_mass, damping_per_mass,
            constant_force, drop, curvature; sine_j, cosine_j and amplitude_j.
        winding: of the electrical test, or None.
        link: between motor and end effector, or None.
        forces: the balance.
        parameters: the model; None without an end effector, for it then has only one mass.
        notes: what could not be told apart, and which experiment would.
    """

    estimate: Estimate
    winding: WindingFit | None
    link: LinkFit | None
    forces: ForceFit
    parameters: AxisParameters | None
    notes: tuple[str, ...]


def identify(
    records: Sequence[Record], force_constant: float | None = None, pole_pitch: float | None = None
) -> IdentifiedAxis:
    """Winding, link and balance of forces, each fitted to the records that show it.

    Args:
        records: electrical tests (with a voltage) and motion; where some motion has the end
            effector, only that counts.
        force_constant: k_t [N/A], instead of an electrical test.
        pole_pitch: tau [m] where it is known.

    Raises:
        ValueError: there is neither an electrical test nor k_t or there are both, there is no
            motion, or a fit says what it lacks.
    """
    _check_positive(force_constant=force_constant, pole_pitch=pole_pitch)
    if bool(electrical(records)) == (force_constant is not None):
        raise ValueError(
            "force_constant: needs an electrical test (with voltage_q), or its value, and not both"
        )
    if not mechanical(records):
        raise ValueError(
            "motion: there is no test of the moving axis (without voltage_q); "
            "masses, friction and cogging need one"
        )
    winding = fit_winding(records) if electrical(records) else None
    scale = _given(force_constant) if winding is None else winding.estimate.derived(_with_constant)
    flexible = with_tool(records)
    link, window = None, WINDOW
    if flexible:
        link = fit_link(flexible)
        period = 2 * np.pi / np.sqrt(link.estimate["stiffness_per_mass"])
        window = min(WINDOW, PASSED * period)
    moving = flexible or mechanical(records)
    forces = fit_forces(moving, scale["force_constant"], pole_pitch, window)
    estimate = _together(scale, link, forces)
    return IdentifiedAxis(
        estimate=estimate,
        winding=winding,
        link=link,
        forces=forces,
        parameters=None if link is None else _parameters(estimate, forces),
        notes=(*_left_out(records), *notes(estimate, forces)),
    )


def _with_constant(values: dict) -> dict:
    """Values of a winding, and k_t = 3/2 k_e."""
    return values | {"force_constant": 1.5 * values["back_emf"]}


def _check_positive(**values: float | None) -> None:
    for name, value in values.items():
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name}: needs to be finite and above zero, received {value}")


def _left_out(records: Sequence[Record]) -> list[str]:
    without = [record.name for record in mechanical(records) if record.tool is None]
    if not (without and with_tool(records)):
        return []
    return [
        f"motion: the tests {', '.join(without)} do not count, "
        "for they have no tool_position and others have it; record it in all"
    ]


def _given(force_constant: float | None) -> Estimate:
    return Estimate(("force_constant",), np.array([force_constant]), np.zeros((1, 1)))


def _together(scale: Estimate, link: LinkFit | None, forces: ForceFit) -> Estimate:
    """All parameters with their joint covariance: the force scale multiplies masses and forces."""
    k_t = scale["force_constant"]

    def physical(value):
        found = dict(value)
        for name in forces.estimate.names:
            if name not in NOT_FORCES:
                found[name] = value[name] * value["force_constant"] / k_t
        if link is not None:
            found["motor_mass"] = found["total_mass"] - found["tool_mass"]
            found["stiffness"] = value["stiffness_per_mass"] * found["tool_mass"]
            found["damping"] = value["damping_per_mass"] * found["tool_mass"]
        for j in range(1, forces.cogging.highest + 1):
            found[f"amplitude_{j}"] = jnp.hypot(found[f"sine_{j}"], found[f"cosine_{j}"])
        if "curvature" in value:
            found["stribeck"] = found["drop"] / value["curvature"]
            found["coulomb"] = found["break_away"] - found["stribeck"]
            found["stribeck_speed"] = jnp.abs(value["curvature"]) ** -0.5
        return found

    links = [] if link is None else [link.estimate]
    return joined(scale, *links, forces.estimate).derived(physical)


def _parameters(estimate: Estimate, forces: ForceFit) -> AxisParameters:
    """The model.

    Friction whose parts cannot be told apart is given a shape that is right up to the fastest speed
    of the data. The mass of an end effector that cannot be seen may come out negative; the model
    then has a light one with the resonance that was found.
    """
    if stribeck_separated(estimate):
        stribeck, stribeck_speed = estimate["stribeck"], estimate["stribeck_speed"]
    else:
        stribeck_speed = 2 * forces.fastest
        most = max(estimate["break_away"], 0.0)
        stribeck = float(np.clip(estimate["drop"] * stribeck_speed**2, 0.0, most))
    tool_mass = max(estimate["tool_mass"], LIGHT * estimate["total_mass"])
    orders = range(1, forces.cogging.highest + 1)
    pole_pitch = forces.cogging.pole_pitch
    if "pole_pitch" in estimate.names:
        pole_pitch = estimate["pole_pitch"]
    return AxisParameters(
        motor_mass=estimate["total_mass"] - tool_mass,
        tool_mass=tool_mass,
        stiffness=estimate["stiffness_per_mass"] * tool_mass,
        damping=estimate["damping_per_mass"] * tool_mass,
        force_constant=estimate["force_constant"],
        friction=Friction(
            max(estimate["break_away"] - stribeck, 0.0),
            stribeck,
            stribeck_speed,
            max(estimate["viscous"], 0.0),
        ),
        cogging_sine=[estimate[f"sine_{j}"] for j in orders],
        cogging_cosine=[estimate[f"cosine_{j}"] for j in orders],
        pole_pitch=pole_pitch,
    )
