"""A loop whose plant answers every control with a constant gain of its own.

    x(k+1) = A x(k) + B (u_0 + g (u(k) - u_0 + force(k)))
u_0 holds the plant at rest where the run begins: zero where drives take a speed or a force, see
`plants.actuation`. With b_i the column of force i, and k_i, d_i the rows of control i in state
and disturbance:

    M(g) = M + sum_i (g_i - 1) b_i k_i',   E(g) = E + sum_i (g_i - 1) b_i (d_i + 1 at force i)'
The run without disturbance moves by the same loop under the force (g_i - 1) (u_i - u_0i). Whole
samples of delay between gain and control change nothing: a constant gain may act before the delay
as well as behind it.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.bounds.disturbed_loop import DisturbedLoop


def gained(loop: DisturbedLoop, gains: Float[np.ndarray, " p"]) -> DisturbedLoop:
    """The loop with other gains, and its run.

    Args:
        loop: at gains of one. The start of its run needs to be the same for all gains, as at rest
            and in a steady motion.
        gains: g, relative.
    """
    return _gained(loop, jnp.asarray(gains, loop.M.dtype))


@jax.jit
def _gained(loop: DisturbedLoop, gains: Float[Array, " p"]) -> DisturbedLoop:
    T, p = loop.control.shape
    extra = loop.E[:, :, :p] * (gains - 1)[None, None]
    received = received_rows(loop)
    M, E = loop.M + extra @ loop.K, loop.E + extra @ received

    def step(z, row):
        M, extra, control = row
        return M @ z + extra @ control, z

    start = jnp.zeros(M.shape[1], M.dtype)
    _, moved = jax.lax.scan(step, start, (M, extra, moving_control(loop)))
    output = loop.output + jnp.einsum("tmn,tn->tm", loop.C, moved)
    control = loop.control + jnp.einsum("tpn,tn->tp", loop.K, moved)
    return DisturbedLoop(M, E, loop.C, loop.K, loop.D, output, control, loop.held)


def moving_control(loop: DisturbedLoop) -> Float[Array, "T p"]:
    """u - u_0 of the undisturbed run: the part of the control that a gain changes."""
    return loop.control - jnp.broadcast_to(loop.held, loop.control.shape)


def received_rows(loop: DisturbedLoop) -> Float[Array, "T p d"]:
    """Direct effect of the disturbances on what the plant receives, u + force."""
    T, p = loop.control.shape
    unit = jnp.broadcast_to(jnp.eye(p, dtype=loop.D.dtype), (T, p, p))
    return jnp.concatenate([unit, loop.D], axis=2)
