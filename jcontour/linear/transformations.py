"""Linear plants from linear plants: discretisation, input delay, input gains, velocity form."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour._arrays import floating, is_concrete
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.linear.small_matrices import exponential


def zoh(A, B, dt: float | Float[Array, ""]) -> tuple[Float[Array, "n n"], Float[Array, "n p"]]:
    """Exact zero-order-hold discretisation of dx/dt = A x + B u.

    The results are the upper blocks of expm([[A, B], [0, 0]] dt).

    Args:
        A: (n, n).
        B: (n, p).
        dt: sample period [s].

    A mass of 2 kg under a force, sampled every 0.1 s:

    >>> A, B = zoh([[0.0, 1.0], [0.0, 0.0]], [[0.0], [0.5]], dt=0.1)
    >>> import numpy as np
    >>> np.asarray(A).round(6).tolist()
    [[1.0, 0.1], [0.0, 1.0]]
    >>> np.asarray(B).round(6).tolist()
    [[0.0025], [0.05]]
    """
    return _held(floating(A), floating(B), dt)


@jax.jit
def _held(A, B, dt):
    n, p = B.shape
    block = jnp.zeros((n + p, n + p), A.dtype).at[:n, :n].set(A).at[:n, n:].set(B)
    discrete = exponential(block * dt)
    return discrete[:n, :n], discrete[:n, n:]


def with_input_delay(plant: LinearPlant, samples: int) -> LinearPlant:
    """Model of a plant whose control acts `samples` late.

    The state gains the line (u(k-1), ..., u(k-samples)). Given maps of steady motion gain the
    control that carries it on.

    Raises:
        ValueError: `samples` is negative.
    """
    if samples < 0:
        raise ValueError(f"samples: a delay cannot be negative, received {samples}")
    if samples == 0:
        return plant
    n, p, line = plant.states, plant.inputs, samples * plant.inputs
    matrices, dtype = (plant.A, plant.B, plant.C), plant.A.dtype
    library = np if is_concrete(*matrices) else jnp  # NumPy has nothing to compile
    A, B, C = (library.asarray(matrix) for matrix in matrices)

    def nothing(rows: int, columns: int):
        return np.zeros((rows, columns), dtype)

    kept = line - p
    late = [
        [A, nothing(n, kept), B],
        [nothing(p, n + line)],
        [nothing(kept, n), np.eye(kept, dtype=dtype), nothing(kept, p)],
    ]
    entry = np.eye(n + line, p, -n, dtype)
    shown = library.concatenate([C, nothing(plant.axes, line)], axis=1)
    motion = None if plant.motion is None else _late_motion(plant, plant.motion, samples)
    matrices = jax.device_put((library.block(late), entry, shown))
    return LinearPlant(*matrices, plant.dt, motion=motion)


def _late_motion(plant: LinearPlant, motion: SteadyMotion, samples: int) -> SteadyMotion:
    """Maps that also hold the line of controls.

    In steady motion the state y -> Sy y + Sv dy goes on to Sy (y + dy) + Sv dy under the control u:

        B u = (I - A) (Sy y + Sv dy) + Sy dy
    """
    stays = jnp.eye(plant.states, dtype=plant.A.dtype) - plant.A

    def with_line(state, change):
        control = jnp.linalg.lstsq(plant.B, change)[0]
        return jnp.concatenate([state, *[control] * samples])

    Sy = with_line(motion.Sy, stays @ motion.Sy)
    return SteadyMotion(Sy, with_line(motion.Sv, stays @ motion.Sv + motion.Sy))


def with_input_gains(plant: LinearPlant, gains) -> LinearPlant:
    """Plant whose input i is scaled by `gains` (p,): B diag(gains)."""
    gains = jnp.broadcast_to(jnp.asarray(gains, plant.B.dtype), (plant.inputs,))
    return eqx.tree_at(lambda p: p.B, plant, plant.B * gains[None])


def velocity_form(plant: LinearPlant) -> LinearPlant:
    """Velocity form: offset-free control without a disturbance model.

    With dx_k = x_k - x_{k-1} and du_k = u_k - u_{k-1}, and a control that acts one sample late
    (Lam, eq. 6),

        [dx_{k+1}; du_k; y_{k+1}] = [[A, B, 0], [0, 0, 0], [C A, C B, I]] [dx_k; du_{k-1}; y_k]
                                    + [0; I; 0] du_k
    The state is [dx (n), du_{k-1} (p), y (m)], the control du_k. A constant force changes x, but
    not how dx moves on: it cancels.
    """
    return LinearPlant(*_velocity_matrices(plant.A, plant.B, plant.C), plant.dt)


@jax.jit
def _velocity_matrices(A, B, C):
    (n, p), m, dtype = B.shape, C.shape[0], A.dtype
    N = n + p + m
    controls, outputs = slice(n, n + p), slice(n + p, N)
    A_v = jnp.zeros((N, N), dtype)
    A_v = A_v.at[:n, :n].set(A)
    A_v = A_v.at[:n, controls].set(B)
    A_v = A_v.at[outputs, :n].set(C @ A)
    A_v = A_v.at[outputs, controls].set(C @ B)
    A_v = A_v.at[outputs, outputs].set(jnp.eye(m, dtype=dtype))
    B_v = jnp.zeros((N, p), dtype).at[controls].set(jnp.eye(p, dtype=dtype))
    C_v = jnp.zeros((m, N), dtype).at[:, outputs].set(jnp.eye(m, dtype=dtype))
    return A_v, B_v, C_v
