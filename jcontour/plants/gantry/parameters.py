"""Masses, geometry, springs and drives of a moving gantry (Yuan, section 5.1.1).

Two linear drives carry a beam on springs, a head drive runs along the beam. Coordinates q = (x_h,
y_N, theta): head along the beam, centre of the beam, angle of the beam; with s, c = sin, cos theta

    drives   P_1 = (-L c - l, y_N - L s),  P_2 = (L c + l, y_N + L s)
    tool     P_e = (x_h c + d s, y_N + x_h s - d c)
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._tracing import is_concrete

Scalar = Float[Array, ""]
Coordinates = Float[Array, "3"]

POSITIVE = (
    "drive_mass_1",
    "drive_mass_2",
    "beam_mass",
    "head_mass",
    "half_span",
    "head_constant",
    "drive_constant",
)
NEEDS = {**dict.fromkeys(POSITIVE, " and above zero"), "tool_offset": ""}


def _number(value: float | Scalar) -> Scalar:
    return jnp.asarray(value, float)


class GantryParameters(eqx.Module):
    """Masses, geometry, springs and drives.

    Args:
        drive_mass_1: M_1 [kg], the drive at x = -L.
        drive_mass_2: M_2 [kg], the drive at x = +L.
        beam_mass: M_n [kg].
        head_mass: M_e [kg].
        half_span: L [m], from the centre of the beam to a joint: the head runs on -L <= x_h <= L.
        joint_length: l [m], from a joint to its drive.
        half_width: w_N [m], of the beam.
        tool_offset: d [m], from the beam's line to the head's centre of mass, which is the tool;
            its sign is free.
        joint_stiffness: k_r [N m/rad], of the torsional spring at each joint.
        lateral_stiffness: k_s [N/m], of the linear springs between drives and guides.
        head_constant: k_x [N/A].
        drive_constant: k_y [N/A].
        head_viscous: b_x [N s/m].
        drive_viscous: b_y [N s/m].

    Raises:
        ValueError: a mass, the span or a force constant is not above zero, another value but d is
            negative, or one is not finite.
    """

    drive_mass_1: Scalar = eqx.field(converter=_number, kw_only=True)
    drive_mass_2: Scalar = eqx.field(converter=_number, kw_only=True)
    beam_mass: Scalar = eqx.field(converter=_number, kw_only=True)
    head_mass: Scalar = eqx.field(converter=_number, kw_only=True)
    half_span: Scalar = eqx.field(converter=_number, kw_only=True)
    joint_length: Scalar = eqx.field(converter=_number, kw_only=True)
    half_width: Scalar = eqx.field(converter=_number, kw_only=True)
    tool_offset: Scalar = eqx.field(converter=_number, kw_only=True)
    joint_stiffness: Scalar = eqx.field(converter=_number, kw_only=True)
    lateral_stiffness: Scalar = eqx.field(converter=_number, kw_only=True)
    head_constant: Scalar = eqx.field(converter=_number, kw_only=True)
    drive_constant: Scalar = eqx.field(converter=_number, kw_only=True)
    head_viscous: Scalar = eqx.field(converter=_number, kw_only=True)
    drive_viscous: Scalar = eqx.field(converter=_number, kw_only=True)

    def __check_init__(self):
        for name, value in vars(self).items():
            if is_concrete(value):
                numbers = np.asarray(value)
                enough = numbers > 0 if name in POSITIVE else numbers >= 0
                if not np.all(np.isfinite(numbers) & (enough | (name == "tool_offset"))):
                    needed = f"finite{NEEDS.get(name, ' and at least zero')}"
                    raise ValueError(f"{name}: needs to be {needed}, received {value}")

    @property
    def total_mass(self) -> Scalar:
        """Total mass M_t = M_1 + M_2 + M_e + M_n [kg]."""
        return self.drive_mass_1 + self.drive_mass_2 + self.head_mass + self.beam_mass

    @property
    def beam_inertia(self) -> Scalar:
        """Inertia of the beam I_N = M_n (L^2 + w_N^2) / 3 [kg m^2], eq. 5.2."""
        return self.beam_mass * (self.half_span**2 + self.half_width**2) / 3

    def inertia(self, head) -> Scalar:
        """Inertia J(x_h) = J_0 + M_e x_h^2 [kg m^2] about the centre of the beam."""
        drives = self.half_span**2 * (self.drive_mass_1 + self.drive_mass_2)
        return drives + self.beam_inertia + self.head_mass * (self.tool_offset**2 + head**2)

    @jax.jit
    def tool(self, q: Coordinates) -> Float[Array, "2"]:
        """Tool point P_e [m]."""
        (x, y, theta), d = q, self.tool_offset
        sine, cosine = jnp.sin(theta), jnp.cos(theta)
        return jnp.stack([x * cosine + d * sine, y + x * sine - d * cosine])

    @jax.jit
    def motors(self, state: Float[Array, "6"]) -> Float[Array, "6"]:
        """Positions (x_h, y_1, y_2) [m] and speeds [m/s] of the three motors in a state (q, q')."""
        x, y, theta, dx, dy, omega = state
        lift, rise = self.half_span * jnp.sin(theta), self.half_span * jnp.cos(theta) * omega
        return jnp.stack([x, y - lift, y + lift, dx, dy - rise, dy + rise])

    def coordinates(self, motors: Float[Array, "6"]) -> Float[Array, "6"]:
        """State (q, q') from the motors' positions and speeds, the inverse of `motors`.

        It is NaN where no angle brings the drives so far apart.
        """
        x, first, second, dx, d_first, d_second = motors
        theta = jnp.arcsin((second - first) / (2 * self.half_span))
        omega = (d_second - d_first) / (2 * self.half_span * jnp.cos(theta))
        return jnp.stack([x, (first + second) / 2, theta, dx, (d_first + d_second) / 2, omega])


def thesis_gantry() -> GantryParameters:
    """Laser cutter of the thesis as far as it is printed.

    The thesis prints d = 0.2 m and anti-resonances of 47 Hz at x_h = 0 and 45 Hz at 0.66 m. They
    solve (5.12) for k_r and for M_n, with the masses, span and force constants chosen here.
    """
    drive, head, span, half_width, offset = 20.0, 40.0, 0.9, 0.15, 0.2
    # J_0 + L^2 M_t, from the ratio of the two frequencies
    both = head * 0.66**2 / ((47 / 45) ** 2 - 1)
    of_beam = both - 2 * span**2 * 2 * drive - head * (span**2 + offset**2)
    beam = of_beam / (span**2 + (span**2 + half_width**2) / 3)
    return GantryParameters(
        drive_mass_1=drive,
        drive_mass_2=drive,
        beam_mass=beam,
        head_mass=head,
        half_span=span,
        joint_length=0.1,
        half_width=half_width,
        tool_offset=offset,
        joint_stiffness=both * (2 * np.pi * 47) ** 2 / 2,
        lateral_stiffness=1e6,
        head_constant=60.0,
        drive_constant=60.0,
        head_viscous=200.0,
        drive_viscous=200.0,
    )


def untwisted(parameters: GantryParameters, position, speed) -> Float[Array, "6"]:
    """State of a straight beam whose tool is at `position` [m] and moves at `speed` [m/s].

    Raises:
        ValueError: the head would be outside the beam.
    """
    check_on_beam("position", position[..., 0], parameters)
    return _straight(parameters, jnp.asarray(position, float), jnp.asarray(speed, float))


@jax.jit
def _straight(parameters: GantryParameters, position: Array, speed: Array) -> Float[Array, "6"]:
    rest = jnp.zeros_like(position[..., :1])
    return jnp.concatenate(
        [position.at[..., 1].add(parameters.tool_offset), rest, speed, rest], axis=-1
    )


def check_on_beam(name: str, head, parameters: GantryParameters) -> None:
    """Raise ValueError unless every head position, if concrete, lies on the beam."""
    if is_concrete(head, parameters.half_span):
        outside = np.abs(np.asarray(head)) > np.asarray(parameters.half_span)
        if np.any(outside):
            span, found = np.min(parameters.half_span), np.asarray(head)[outside].reshape(-1)[0]
            runs = f"the head runs from -{span:g} to {span:g} m along the beam"
            raise ValueError(f"{name}: {runs}, received {found:g} m")
