"""Linear models of the gantry around a position of the head (Yuan, section 5.3.1).

    x_h'' + b_x / M_e x_h' = k_x / M_e i_x + d_x                                              (5.13)
    M_t y_N'' + 2 b_y y_N' + m theta'' = k_y (i_1 + i_2) + d_1                                (5.14)
    m y_N'' + J theta'' + 2 b_y L^2 theta' + 2 k_r theta = k_y L (i_2 - i_1) + d_2            (5.15)
with m = M_e xbar - M_d L at the head position xbar, J = J(xbar). The thesis has M_d = 0; we keep
it. Its d_1, d_2 lack the terms in x_h - xbar and print "-d theta''" for "-d theta theta''";
`disturbances` has them complete. States are in the order of `Gantry`. `motor_schedule` has the
models over several head positions.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import zoh
from jcontour.plants.gantry.gantry import EquationOfMotion
from jcontour.plants.gantry.parameters import GantryParameters, Scalar, check_on_beam

X = (0, 3)  # where the thesis's states (x_h, x_h') stand
Y = (1, 4, 2, 5)  # where its states (y_N, y_N', theta, theta') stand


class LinearGantry(NamedTuple):
    """Model dx/dt = A x + B u + E d, or one sample of it.

    u = (i_x, i_1, i_2) [A], d = (d_x [m/s^2], d_1 [N], d_2 [N m]).
    """

    A: Float[Array, "*batch 6 6"]
    B: Float[Array, "*batch 6 3"]
    E: Float[Array, "*batch 6 3"]

    def sampled(self, dt: float) -> "LinearGantry":
        """Exact zero-order hold of currents and disturbances."""
        A, both = zoh(self.A, jnp.concatenate([self.B, self.E], axis=1), dt)
        return LinearGantry(A, both[:, :3], both[:, 3:])


# the model at a head position [m]: `tangent` or `control_oriented`
Linearisation = Callable[[GantryParameters, Scalar | float], LinearGantry]


def control_oriented(parameters: GantryParameters, head: Scalar | float) -> LinearGantry:
    """Model (5.13)-(5.15) at a head position [m].

    Raises:
        ValueError: the head is outside the beam.
    """
    mass = _mass_matrix(parameters, head)
    apart = mass.at[0, 1:].set(0).at[1:, 0].set(0)
    push = jnp.array([1.0, 0, 0]) * parameters.head_mass + jnp.array([0, 1.0, 1.0])
    return _solved(parameters, apart, jnp.diag(push))


def tangent(parameters: GantryParameters, head: Scalar | float) -> LinearGantry:
    """Derivative of the equation of motion at rest.

    It is (5.13)-(5.15) with M_e d theta'' and M_e d x_h'' kept; d acts as forces on q.

    Raises:
        ValueError: the head is outside the beam.
    """
    return _solved(parameters, _mass_matrix(parameters, head), jnp.eye(3))


def tool_plant(
    parameters: GantryParameters, head: Scalar | float, dt: float, linear: Linearisation = tangent
) -> LinearPlant:
    """Sampled linear model whose outputs C x are the tool.

    Its state is (x_h, y_N - d, theta, rates).

    Raises:
        ValueError: the head is outside the beam, or `dt` is not above zero.
    """
    A, B, _ = linear(parameters, head).sampled(dt)
    return LinearPlant(A, B, tool_matrix(parameters, head), dt)


def tool_matrix(parameters: GantryParameters, head) -> Float[Array, "2 6"]:
    """Matrix C of `tool_plant`: tool (x_h + d theta, y_N - d + xbar theta) for small angles."""
    return jnp.eye(2, 6).at[:, 2].set(jnp.stack([parameters.tool_offset, jnp.asarray(head, float)]))


def drive_response(
    parameters: GantryParameters, head, coupling
) -> tuple[Float[Array, "3"], Float[Array, "4"]]:
    """Transfer function from the current i_1 to the speed y_1', highest power first, eq. 5.12.

        k_y ((J + L^2 M_t + 2 L m) s^2 + 4 b_y L^2 s + 2 k_r)
            / ((M_t s + 2 b_y) (J s^2 + 2 b_y L^2 s + 2 k_r) - m^2 s^3)
    The thesis drops the coupling m. With it the anti-resonance at 0.66 m moves from 45 Hz to 51.2
    or 40.6 Hz, depending on the side of the head.

    Args:
        parameters: of the machine.
        head: xbar [m].
        coupling: m [kg m]: 0 as printed, `head_mass * head` kept.
    """
    p = parameters
    L, b, k, J, m = p.half_span, p.drive_viscous, 2 * p.joint_stiffness, p.inertia(head), coupling
    numerator = p.drive_constant * jnp.stack([J + L**2 * p.total_mass + 2 * L * m, 4 * b * L**2, k])
    beam, twist = jnp.stack([p.total_mass, 2 * b]), jnp.stack([J, 2 * b * L**2, k])
    return numerator, jnp.convolve(beam, twist).at[0].add(-(m**2))


def _mass_matrix(parameters: GantryParameters, head) -> Float[Array, "3 3"]:
    """Mass matrix M of the straight beam."""
    check_on_beam("head", head, parameters)
    head = jnp.asarray(head, float)
    none = jnp.zeros_like(head)
    return EquationOfMotion.of(parameters).mass_matrix(jnp.stack([head, none, none]))


@jax.jit
def _solved(
    p: GantryParameters, mass: Float[Array, "3 3"], push: Float[Array, "3 3"]
) -> LinearGantry:
    """First-order system of q'' = M^-1 (currents + push d - friction - springs)."""
    motion, none = EquationOfMotion.of(p), jnp.zeros(())
    friction = jnp.stack([motion.head_viscous, motion.beam_viscous, motion.turning_viscous])
    springs = jnp.stack([none, none, motion.joints])
    k_x, k_y, k_t = motion.head_constant, motion.beam_constant, motion.turning_constant
    rows = [[k_x, none, none], [none, k_y, k_y], [none, -k_t, k_t]]
    currents = jnp.stack([jnp.stack(row) for row in rows])
    columns = jnp.concatenate([-jnp.diag(springs), -jnp.diag(friction), currents, push], axis=1)
    rates = jnp.concatenate([jnp.eye(3, 12, 3), jnp.linalg.solve(mass, columns)])
    return LinearGantry(rates[:, :6], rates[:, 6:9], rates[:, 9:])
