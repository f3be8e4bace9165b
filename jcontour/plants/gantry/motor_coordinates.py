"""The gantry in the readings of its three motor encoders: z = (x_h, y_1 - d, y_2 - d, rates).

All are zero where the tool is at the origin. For small angles z = T (x_h, y_N - d, theta),
y_1,2 = y_N -+ L theta. So the motors' positions and speeds are the whole state, and no observer is
needed. A controller of the motors uses the models of `linear_models` in these coordinates.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.linear.model_schedule import ModelSchedule
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.plants.gantry.linear_models import Linearisation, tangent, tool_plant
from jcontour.plants.gantry.parameters import GantryParameters, Scalar, check_on_beam

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
    return LinearPlant(*matrices, dt, motion=straight_motion(dt))


@eqx.filter_jit
def _matrices(parameters: GantryParameters, head: Scalar | float, dt: float, linear: Linearisation):
    """Matrices A, B, C of `motor_model`."""
    model, L = tool_plant(parameters, head, dt, linear), parameters.half_span
    none, one = jnp.zeros(()), jnp.ones(())
    rows = [[one, none, none], [none, one, -L], [none, one, L]]
    positions = jnp.stack([jnp.stack(row) for row in rows])
    T = jnp.kron(jnp.eye(2), positions)
    back = jnp.kron(jnp.eye(2), jnp.linalg.inv(positions))
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


def straight_motion(dt: float) -> SteadyMotion:
    """Readings of a straight beam whose tool moves steadily."""
    motors = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    none = np.zeros_like(motors)
    maps = np.concatenate([motors, none]), np.concatenate([none, motors / dt])
    return SteadyMotion(*(jnp.asarray(each, float) for each in maps))
