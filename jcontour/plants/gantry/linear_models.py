"""Linear models of the gantry around a position of the head (Yuan, section 5.3.1).

    x_h'' + b_x / M_e x_h' = k_x / M_e i_x + d_x                                              (5.13)
    M_t y_N'' + 2 b_y y_N' + m theta'' = k_y (i_1 + i_2) + d_1                                (5.14)
    m y_N'' + J theta'' + 2 b_y L^2 theta' + 2 k_r theta = k_y L (i_2 - i_1) + d_2            (5.15)
with m = M_e xbar - M_d L at the head position xbar, J = J(xbar). The thesis has M_d = 0; we keep
it. Its d_1, d_2 lack the terms in x_h - xbar and print "-d theta''" for "-d theta theta''";
`disturbances` has them complete. States are in the order of `Gantry`. `motor_schedule` has the
models over several head positions.

The readings of the three motor encoders are z = (x_h, y_1 - d, y_2 - d, rates). All are zero where
the tool is at the origin. For small angles z = T (x_h, y_N - d, theta), y_1,2 = y_N -+ L theta. So
the motors' positions and speeds are the whole state, and no observer is needed. A controller of the
motors uses these models in their coordinates.

With a straight beam (5.7)-(5.9) are inverted at theta = 0. The tool is then at (x_h, y_N - d). The
turning moment of the head, M_e (d x_h'' + x_h y_N''), is held by the difference of the two drives.

The terms that the model leaves out are its disturbances:

    d_x = x_h'' + b_x / M_e x_h' - k_x / M_e i_x                                   [m/s^2]
    d_1 = M_t y_N'' + 2 b_y y_N' + m theta'' - k_y (i_1 + i_2)                     [N]
    d_2 = m y_N'' + J theta'' + 2 b_y L^2 theta' + 2 k_r theta - k_y L (i_2 - i_1)   [N m]
with the accelerations of (5.7)-(5.9), and m and J at the point of linearisation. Under them
(5.13)-(5.15) hold exactly. The thesis writes them out term by term, without the terms in
x_h - xbar and with a misprint.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.linear.model_schedule import ModelSchedule
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.linear.small_matrices import small_inverse, small_solve
from jcontour.linear.transformations import zoh
from jcontour.plants.gantry.gantry import EquationOfMotion, GantryParameters, Scalar, check_on_beam

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
    # tool (x_h + d theta, y_N - d + xbar theta) for small angles
    turned = jnp.stack([parameters.tool_offset, jnp.asarray(head, float)])
    return LinearPlant(A, B, jnp.eye(2, 6).at[:, 2].set(turned), dt)


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
    rates = jnp.concatenate([jnp.eye(3, 12, 3), small_solve(mass, columns)])
    return LinearGantry(rates[:, :6], rates[:, 6:9], rates[:, 9:])


HOMED = np.array(
    [0.0, 1.0, 1.0, 0.0, 0.0, 0.0]
)  # readings that are zero where the tool is at y = 0


class MotorEncoders(eqx.Module):
    """Encoder readings of a `Gantry`, the Y axes homed where the tool is at y = 0."""

    parameters: GantryParameters

    def __call__(self, state: Float[Array, "6"]) -> Float[Array, "6"]:
        """Readings (x_h, y_1 - d, y_2 - d) [m] and their speeds [m/s] in a state."""
        return self.parameters.motors(state) - HOMED * self.parameters.tool_offset

    def state(self, reading: Float[Array, "6"]) -> Float[Array, "6"]:
        """State with these readings."""
        return self.parameters.coordinates(reading.at[1:3].add(self.parameters.tool_offset))


def motor_model(
    parameters: GantryParameters, head: Scalar | float, dt: float, linear: Linearisation = tangent
) -> LinearPlant:
    """Linear model at a head position [m], its state the encoder readings, its outputs the tool.

    Raises:
        ValueError: the head is outside the beam, or `dt` is not above zero.
    """
    check_on_beam("head", head, parameters)
    matrices = _matrices(parameters, jnp.asarray(head, float), dt, linear)
    # Readings of a straight beam whose tool moves steadily
    motors = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    none = np.zeros_like(motors)
    maps = np.concatenate([motors, none]), np.concatenate([none, motors / dt])
    return LinearPlant(
        *matrices, dt, motion=SteadyMotion(*(jnp.asarray(each, float) for each in maps))
    )


@eqx.filter_jit
def _matrices(parameters: GantryParameters, head: Scalar | float, dt: float, linear: Linearisation):
    """Matrices A, B, C of `motor_model`."""
    model, L = tool_plant(parameters, head, dt, linear), parameters.half_span
    none, one = jnp.zeros(()), jnp.ones(())
    rows = [[one, none, none], [none, one, -L], [none, one, L]]
    positions = jnp.stack([jnp.stack(row) for row in rows])
    T = jnp.kron(jnp.eye(2), positions)
    back = jnp.kron(jnp.eye(2), small_inverse(positions))
    return T @ model.A @ back, T @ model.B, model.C @ back


def motor_schedule(
    parameters: GantryParameters, points, dt: float, linear: Linearisation = tangent
) -> ModelSchedule:
    """Models at several head positions.

    Raises:
        ValueError: a point is outside the beam or out of order, or `dt` is not above zero.
    """
    points = jnp.asarray(points, float)
    check_on_beam("points", points, parameters)
    models = jax.vmap(lambda head: motor_model(parameters, head, dt, linear))(points)
    return ModelSchedule(models, points, output=0)


def straight_beam_currents(
    parameters: GantryParameters,
    position: Float[Array, "S 2"],
    speed: Float[Array, "S 2"],
    acceleration: Float[Array, "S 2"],
) -> Float[Array, "S 3"]:
    """Currents (i_x, i_1, i_2) [A] under which the tool has these accelerations.

    Args:
        parameters: of the machine.
        position: of the tool [m].
        speed: [m/s].
        acceleration: [m/s^2].

    Raises:
        ValueError: the head would be outside the beam.
    """
    check_on_beam("position", position[:, 0], parameters)
    return _currents(EquationOfMotion.of(parameters), position, speed, acceleration)


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, 0, 0))
def _currents(
    motion: EquationOfMotion, position: Array, speed: Array, acceleration: Array
) -> Float[Array, "3"]:
    """Currents of every sample."""
    none = jnp.zeros(())
    q, v = jnp.stack([position[0], none, none]), jnp.append(speed, none)
    driven = jnp.stack(motion.bias(q, v)) - jnp.stack(motion.forces(q, v, jnp.zeros(3)))
    along, across, turning = motion.mass_matrix(q) @ jnp.append(acceleration, none) + driven
    both, apart = across / motion.beam_constant, turning / motion.turning_constant
    return jnp.stack([along / motion.head_constant, (both - apart) / 2, (both + apart) / 2])


def currents_along(
    parameters: GantryParameters, position: Float[Array, "S 2"], dt: float
) -> Float[Array, "S 3"]:
    """Currents held for a sample each, along samples of the tool that begin and end at rest.

    Args:
        parameters: of the machine.
        position: of the tool [m].
        dt: sample period [s].

    Raises:
        ValueError: the head would be outside the beam.
    """
    wide = jnp.concatenate([position[:1], position, position[-1:], position[-1:]])
    speed = jnp.diff(wide, axis=0) / dt
    # the mean acceleration in a sample is that between the samples before and after it
    acceleration = (speed[2:] - speed[:-2]) / (2 * dt)
    return straight_beam_currents(parameters, position, speed[1:-1], acceleration)


def disturbances(
    parameters: GantryParameters, head, state: Float[Array, "6"], control: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Disturbances (d_x, d_1, d_2) of the linear model at a head position.

    Args:
        parameters: of the machine.
        head: xbar [m].
        state: state of `Gantry`.
        control: currents (i_x, i_1, i_2) [A].

    Raises:
        ValueError: the point of linearisation is outside the beam.
    """
    check_on_beam("head", head, parameters)
    motion, p = EquationOfMotion.of(parameters), parameters
    q, (x, y, turn), (i_x, i_1, i_2) = state[:3], state[3:], control
    ddx, ddy, ddturn = motion.acceleration(q, state[3:], control)
    m, J, L = p.head_mass * head - motion.imbalance, p.inertia(head), p.half_span
    d_x = ddx + (p.head_viscous * x - p.head_constant * i_x) / p.head_mass
    d_1 = p.total_mass * ddy + 2 * p.drive_viscous * y + m * ddturn - p.drive_constant * (i_1 + i_2)
    resisting = 2 * p.drive_viscous * L**2 * turn + 2 * p.joint_stiffness * q[2]
    d_2 = m * ddy + J * ddturn + resisting - p.drive_constant * L * (i_2 - i_1)
    return jnp.stack([d_x, d_1, d_2])
