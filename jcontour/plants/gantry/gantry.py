"""Moving gantry whose beam twists when its two drives disagree (Yuan, section 5.1).

    M(q) q'' + h(q, q') = Q(q, q', u)                       (5.7)-(5.9), Q from (5.4)-(5.6)
    K = sum of 1/2 M_i |V_i|^2 + 1/2 I_N theta'^2           (5.1)-(5.3)
    P = k_r theta^2 + k_s L^2 (1 - cos theta)^2
with u = (i_x, i_1, i_2) and the coordinates q below. The current loops are ideal. A
sample is integrated by classical Runge-Kutta substeps under held currents.

Two linear drives carry a beam on springs, a head drive runs along the beam. Coordinates q = (x_h,
y_N, theta): head along the beam, centre of the beam, angle of the beam; with s, c = sin, cos theta

    drives   P_1 = (-L c - l, y_N - L s),  P_2 = (L c + l, y_N + L s)
    tool     P_e = (x_h c + d s, y_N + x_h s - d c)
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import is_concrete
from jcontour.plant import Plant
from jcontour.plants.friction import runge_kutta, substeps_of

SUBSTEP = 2.5e-4  # [s] a forty-sixth of the period of the fastest resonance, 86 Hz

Scalar = Float[Array, ""]
Coordinates = Float[Array, "3"]
# one scalar a coordinate, because a compiler puts a stack of them in a kernel of its own
Triple = tuple[Scalar, Scalar, Scalar]
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


class EquationOfMotion(NamedTuple):
    """Equation of motion with its lumped coefficients."""

    total_mass: Scalar  # M_t [kg]
    head_mass: Scalar  # M_e [kg]
    tool_offset: Scalar  # d [m]
    imbalance: Scalar  # M_d L = (M_1 - M_2) L [kg m]
    inertia: Scalar  # J_0 [kg m^2], with the head at the centre of the beam
    joints: Scalar  # 2 k_r [N m/rad]
    guides: Scalar  # 2 k_s L^2 [N m]
    head_viscous: Scalar  # b_x [N s/m]
    beam_viscous: Scalar  # 2 b_y [N s/m]
    turning_viscous: Scalar  # 2 b_y L^2 [N m s]
    head_constant: Scalar  # k_x [N/A]
    beam_constant: Scalar  # k_y [N/A]
    turning_constant: Scalar  # k_y L [N m/A]

    @classmethod
    @partial(jax.jit, static_argnums=0)
    def of(cls, p: GantryParameters) -> "EquationOfMotion":
        """Equation of motion of a machine."""
        return cls(
            total_mass=p.total_mass,
            head_mass=p.head_mass,
            tool_offset=p.tool_offset,
            imbalance=(p.drive_mass_1 - p.drive_mass_2) * p.half_span,
            inertia=p.inertia(0.0),
            joints=2 * p.joint_stiffness,
            guides=2 * p.lateral_stiffness * p.half_span**2,
            head_viscous=p.head_viscous,
            beam_viscous=2 * p.drive_viscous,
            turning_viscous=2 * p.drive_viscous * p.half_span**2,
            head_constant=p.head_constant,
            beam_constant=p.drive_constant,
            turning_constant=p.drive_constant * p.half_span,
        )

    def mass_matrix(self, q: Coordinates | Triple) -> Float[Array, "3 3"]:
        """Mass matrix M(q)."""
        x, _, theta = q
        M_e, d = self.head_mass, self.tool_offset
        sine = jnp.sin(theta)
        yaw = M_e * d * sine + (M_e * x - self.imbalance) * jnp.cos(theta)
        head = jnp.stack([M_e, M_e * sine, M_e * d])
        beam = jnp.stack([M_e * sine, self.total_mass, yaw])
        angle = jnp.stack([M_e * d, yaw, self.inertia + M_e * x**2])
        return jnp.stack([head, beam, angle])

    def bias(self, q: Coordinates | Triple, v: Coordinates | Triple) -> Triple:
        """Centrifugal, Coriolis and spring terms h(q, q') [N, N, N m]."""
        (x, _, theta), (dx, _, omega) = q, v
        M_e, d, sine, cosine = self.head_mass, self.tool_offset, jnp.sin(theta), jnp.cos(theta)
        of_head = M_e * (2 * dx * omega * cosine + omega**2 * (d * cosine - x * sine))
        across = of_head + self.imbalance * omega**2 * sine
        turning = 2 * M_e * omega * dx * x + self.joints * theta + self.guides * sine * (1 - cosine)
        return -M_e * x * omega**2, across, turning

    def forces(
        self, q: Coordinates | Triple, v: Coordinates | Triple, control: Float[Array, "3"]
    ) -> Triple:
        """Forces Q [N, N, N m] of currents and viscous friction, eqs. 5.4-5.6."""
        (dx, dy, omega), (i_x, i_1, i_2) = v, control
        cosine = jnp.cos(q[2])
        along = self.head_constant * i_x - self.head_viscous * dx
        across = self.beam_constant * (i_1 + i_2) - self.beam_viscous * dy
        turning = self.turning_constant * (i_2 - i_1) - self.turning_viscous * cosine * omega
        return along, across, turning * cosine

    def acceleration(self, q: Coordinates, v: Coordinates, control: Float[Array, "3"]) -> Triple:
        """Acceleration q'' = M^-1 (Q - h), in closed form.

        The head's line, M_e (x_h'' + s y_N'' + d theta'') = r_x, subtracted from the others leaves

            (M_t - M_e s^2) y_N'' + c (M_e x_h - M_d L) theta''  = r_y - s r_x
            c (M_e x_h - M_d L) y_N'' + (J - M_e d^2) theta''    = r_theta - d r_x.
        Each entry ends in its own division: a compiler that never repeats a division then keeps
        the rest in one kernel.
        """
        x, _, theta = q
        M_e, d, sine = self.head_mass, self.tool_offset, jnp.sin(theta)
        pairs = zip(self.forces(q, v, control), self.bias(q, v), strict=True)
        along, across, turning = (Q - h for Q, h in pairs)
        across, turning = across - sine * along, turning - d * along
        mass, inertia = self.total_mass - M_e * sine**2, self.inertia + M_e * (x**2 - d**2)
        yaw = (M_e * x - self.imbalance) * jnp.cos(theta)
        determinant = mass * inertia - yaw**2
        beam, angle = inertia * across - yaw * turning, mass * turning - yaw * across
        head = along * determinant - M_e * (sine * beam + d * angle)
        return head / (M_e * determinant), beam / determinant, angle / determinant

    def beam_acceleration(
        self, q: Coordinates, v: Coordinates, control: Float[Array, "3"], along: Scalar
    ) -> tuple[Scalar, Scalar]:
        """Acceleration (y_N'', theta'') by (5.8) and (5.9) for a given x_h'' = `along` [m/s^2]."""
        M_e, x, sine = self.head_mass, q[0], jnp.sin(q[2])
        pairs = zip(self.forces(q, v, control), self.bias(q, v), strict=True)
        _, across, turning = (Q - h for Q, h in pairs)
        across, turning = across - M_e * sine * along, turning - M_e * self.tool_offset * along
        yaw = M_e * self.tool_offset * sine + (M_e * x - self.imbalance) * jnp.cos(q[2])
        inertia = self.inertia + M_e * x**2
        determinant = self.total_mass * inertia - yaw**2
        beam = (inertia * across - yaw * turning) / determinant
        return beam, (self.total_mass * turning - yaw * across) / determinant


class GantryPlant(Plant):
    """Common part of the gantries: a sample is integrated in substeps.

    Args:
        parameters: of the machine.
        dt: sample period [s].
        substeps: per sample; as many as `SUBSTEP` fits into the sample when not given.

    Raises:
        ValueError: `dt` is not above zero, or the substep does not divide it.
    """

    parameters: GantryParameters
    dt: float = eqx.field(static=True)
    substeps: int = eqx.field(static=True)

    def __init__(
        self, parameters: GantryParameters, dt: float, substeps: int | float | None = None
    ):
        self.parameters, self.dt = parameters, float(dt)
        self.substeps = substeps_of(dt, substeps, SUBSTEP)

    @property
    def alike_everywhere(self) -> tuple[bool, ...]:
        """Along Y; the place of the head on the beam changes the inertia of twist."""
        return False, True

    def straight(self, position, increment) -> Float[Array, "6"]:
        """State (q, q') without twist, the tool through `position`, at rest or moving steadily.

        Raises:
            ValueError: the head would be outside the beam.
        """
        return untwisted(self.parameters, position, jnp.asarray(increment) / self.dt)


class Gantry(GantryPlant):
    """The gantry under currents (i_x, i_1, i_2) [A], its whole state measured.

    The state is (q, q') = (x_h, y_N, theta, rates).

    >>> from jcontour.plants.gantry.gantry import thesis_gantry
    >>> gantry = Gantry(thesis_gantry(), dt=1e-3)
    >>> start = gantry.initial_state(jnp.array([0.1, 0.2]), jnp.zeros(2))
    >>> start.shape, bool(jnp.allclose(gantry.output(start), jnp.array([0.1, 0.2])))
    ((6,), True)
    """

    def __init__(
        self, parameters: GantryParameters, dt: float, substeps: int | float | None = None
    ):
        super().__init__(parameters, dt, substeps)

    def initial_state(self, position, increment) -> Float[Array, "6"]:
        return self.straight(position, increment)

    def step(self, state, control) -> Float[Array, "6"]:
        h = self.dt / self.substeps
        # one vector: a third faster than thirteen scalars
        coefficients = jnp.stack(EquationOfMotion.of(self.parameters))

        # reverse mode computes a stage again instead of storing it: four times faster
        @jax.checkpoint
        def rates(coefficients, control, state):
            q, v = state[:3], state[3:]
            return jnp.stack([*v, *EquationOfMotion(*coefficients).acceleration(q, v, control)])

        def substep(_, state):
            return runge_kutta(lambda x: rates(coefficients, control, x), state, h)

        return jax.lax.fori_loop(0, self.substeps, substep, state)

    def output(self, state) -> Float[Array, "2"]:
        return self.parameters.tool(state[:3])
