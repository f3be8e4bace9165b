"""Currents that move the gantry's tool with a straight beam: the inverse of (5.7)-(5.9), theta = 0.

The tool is then at (x_h, y_N - d). The turning moment of the head, M_e (d x_h'' + x_h y_N''), is
held by the difference of the two drives.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.plants.gantry.gantry import EquationOfMotion
from jcontour.plants.gantry.parameters import GantryParameters, check_on_beam


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
