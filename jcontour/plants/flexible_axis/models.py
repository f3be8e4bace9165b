"""Linear models of the flexible axis: eqs. 3.1, 3.2 without dry friction and cogging.

The viscous part of the friction is kept. The state is [x_m, v_m, x_e, v_e], each for all m axes:
the measured states come first. The output is the end effector.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.linear.plant import LinearPlant, Pattern
from jcontour.linear.transformations import zoh
from jcontour.plants.flexible_axis.axis import AxisParameters


@eqx.filter_jit
def zoh_model(parameters: AxisParameters, dt: float) -> LinearPlant:
    """Model that is exact under a control held over the sample.

    Raises:
        ValueError: `dt` is not above zero.
    """
    A, B = jax.vmap(lambda A, B: zoh(A, B, dt))(*rate_matrices(parameters))
    return _side_by_side(A, B, dt)


@eqx.filter_jit
def euler_model(parameters: AxisParameters, dt: float) -> LinearPlant:
    """Model by forward Euler, A = I + dt A_c (Yuan, eq. 4.4).

    It makes the thesis's axis unstable at 1 ms: |eig A| = 1.00104.

    Raises:
        ValueError: `dt` is not above zero.
    """
    A, B = rate_matrices(parameters)
    return _side_by_side(jnp.broadcast_to(jnp.eye(4), A.shape) + dt * A, dt * B, dt)


def rate_matrices(p: AxisParameters) -> tuple[Float[Array, "m 4 4"], Float[Array, "m 4 1"]]:
    """Rates of every axis, dx/dt = A x + B u, x = (x_m, v_m, x_e, v_e)."""
    values = (p.motor_mass, p.tool_mass, p.stiffness, p.damping, p.friction.viscous)
    M, m, k, c, b = (jnp.broadcast_to(value, (p.axes,)) for value in values)
    zero, one = jnp.zeros(p.axes), jnp.ones(p.axes)
    rows = [
        [zero, one, zero, zero],
        [-k / M, -(c + b) / M, k / M, c / M],
        [zero, zero, zero, one],
        [k / m, c / m, -k / m, -c / m],
    ]
    A = jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)
    return A, jnp.stack([zero, p.force_constant / M, zero, zero], axis=-1)[..., None]


def _side_by_side(A: Float[Array, "m 4 4"], B: Float[Array, "m 4 1"], dt: float) -> LinearPlant:
    """One plant of all axes; its pattern is known even where the parameters are traced."""
    axes = A.shape[0]
    apart = np.eye(axes)
    whole = jnp.einsum("kij,kl->ikjl", A, apart).reshape(4 * axes, 4 * axes)
    inputs = jnp.einsum("ki,kl->ikl", B[..., 0], apart).reshape(4 * axes, axes)
    tool = np.kron([0.0, 0.0, 1.0, 0.0], apart)
    pattern = Pattern.of(np.kron(np.ones((4, 4)), apart), np.kron(np.ones((4, 1)), apart), tool)
    return LinearPlant(whole, inputs, tool, dt, pattern)
