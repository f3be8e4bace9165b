"""Moving gantry whose beam twists when its two drives disagree (Yuan, section 5.1).

    M(q) q'' + h(q, q') = Q(q, q', u)                       (5.7)-(5.9), Q from (5.4)-(5.6)
    K = sum of 1/2 M_i |V_i|^2 + 1/2 I_N theta'^2           (5.1)-(5.3)
    P = k_r theta^2 + k_s L^2 (1 - cos theta)^2
with u = (i_x, i_1, i_2) and the coordinates q of `parameters`. The current loops are ideal. A
sample is integrated by classical Runge-Kutta substeps under held currents.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.plant import Plant
from jcontour.plants.gantry.parameters import Coordinates, GantryParameters, Scalar, untwisted
from jcontour.plants.integrators import runge_kutta

SUBSTEP = 2.5e-4  # [s] a forty-sixth of the period of the fastest resonance, 86 Hz

# one scalar a coordinate, because a compiler puts a stack of them in a kernel of its own
Triple = tuple[Scalar, Scalar, Scalar]


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

    def energy(self, q: Coordinates, v: Coordinates) -> Scalar:
        """Energy K + P [J]."""
        springs = self.joints * q[2] ** 2 + self.guides * (1 - jnp.cos(q[2])) ** 2
        return (v @ self.mass_matrix(q) @ v + springs) / 2


class Gantry(Plant):
    """The gantry under currents (i_x, i_1, i_2) [A], its whole state measured.

    The state is (q, q') = (x_h, y_N, theta, rates).

    >>> from jcontour.plants.gantry.parameters import thesis_gantry
    >>> gantry = Gantry(thesis_gantry(), dt=1e-3)
    >>> start = gantry.initial_state(jnp.array([0.1, 0.2]), jnp.zeros(2))
    >>> start.shape, bool(jnp.allclose(gantry.output(start), jnp.array([0.1, 0.2])))
    ((6,), True)

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
        self.parameters, self.dt, self.substeps = parameters, float(dt), substeps_of(dt, substeps)

    @property
    def alike_everywhere(self) -> tuple[bool, ...]:
        """Along Y; the place of the head on the beam changes the inertia of twist."""
        return False, True

    def initial_state(self, position, increment) -> Float[Array, "6"]:
        """State without twist, the tool through `position`, at rest or at a steady speed.

        Raises:
            ValueError: the head would be outside the beam.
        """
        return untwisted(self.parameters, position, jnp.asarray(increment) / self.dt)

    def step(self, state, control) -> Float[Array, "6"]:
        """State after the substeps of one sample."""
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
        """The tool [m]."""
        return self.parameters.tool(state[:3])


def substeps_of(dt: float, substeps: int | float | None) -> int:
    """Substeps per sample; ValueError unless `dt` holds a whole number of them."""
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt: needs to be finite and above zero, received {dt}")
    count = round(dt / SUBSTEP) if substeps is None else substeps
    if count < 1 or (substeps is None and abs(count * SUBSTEP - dt) > 1e-9 * dt):
        raise ValueError(
            f"substeps: {SUBSTEP} s does not divide the sample period {dt} s; give their number"
        )
    return int(count)
