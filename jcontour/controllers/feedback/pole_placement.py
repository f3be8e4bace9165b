"""Pole placement for axes with one input each, by Ackermann's formula (Yuan, section 2.2.3).

    K = [0 ... 0 1] [B, D B, ..., D^(n-1) B]^-1 (D - q_1 I) ... (D - q_n I)
    D = A - I,  q_i = p_i - 1
Poles of a machine sampled fast crowd around 1. Differences from 1 keep the digits that the powers
of A would lose.
"""

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Complex, Float, Num

from jcontour._arrays import ranked
from jcontour._tracing import is_concrete
from jcontour.linear.plant import Axis, LinearPlant, decoupled_axes


def placed_gain(
    model: LinearPlant, poles: Num[ArrayLike, "*m s"] | Sequence[float | complex]
) -> Float[Array, "p n"]:
    """Gain K that gives every axis of the loop A - B K these poles.

    Args:
        model: decoupled axes with one input each.
        poles: poles of the sampled loop, the same for all axes or one row for each, as many as
            an axis has states; complex ones in pairs.

    Raises:
        ValueError: an axis has another number of inputs or poles, cannot be controlled, or a pole
            is not inside the unit circle or lacks its conjugate.
    """
    axes = decoupled_axes(model.pattern)
    poles = jnp.asarray(poles, complex)
    for axis in axes:
        if len(axis.inputs) != 1:
            found = f"states {list(axis.states)} have {len(axis.inputs)}"
            raise ValueError(f"model: pole placement needs one input for each axis, {found}")
        if poles.shape[-1] != len(axis.states):
            raise ValueError(
                f"poles: the axis has {len(axis.states)} states, received {poles.shape[-1]} poles"
            )
    if is_concrete(poles):
        for wanted in np.asarray(poles).reshape(-1, poles.shape[-1]):
            _check_poles(wanted)
    K = _of_axes(model.A, model.B, poles, axes)
    if is_concrete(K):
        for axis in axes:
            if not np.isfinite(np.asarray(K)[axis.inputs[0]]).all():
                raise ValueError(
                    f"model: the axis of the states {list(axis.states)} cannot be controlled"
                )
    return K


def damped_poles(
    frequency: ArrayLike | Sequence[float], damping: ArrayLike | Sequence[float], dt: float
) -> Complex[Array, " s"]:
    """Sampled poles exp(s dt) of k pairs s^2 + 2 zeta w s + w^2, w [rad/s].

    Raises:
        ValueError: a frequency is not above zero, or a damping not between zero and one.
    """
    w = ranked(frequency, 1)
    zeta = ranked(damping, 1)
    if is_concrete(w) and not np.all(np.asarray(w) > 0):
        raise ValueError(f"frequency: needs to be above zero, received {frequency}")
    if is_concrete(zeta) and not np.all((np.asarray(zeta) > 0) & (np.asarray(zeta) < 1)):
        raise ValueError(f"damping: needs to be between 0 and 1, received {damping}")
    s = jax.lax.complex(-(w * zeta), w * jnp.sqrt(1 - zeta**2))
    return jnp.exp(dt * jnp.concatenate([s, s.conj()]))


@partial(jax.jit, static_argnums=3)
def _of_axes(
    A: Float[Array, "n n"],
    B: Float[Array, "n p"],
    poles: Complex[Array, "*m s"],
    axes: tuple[Axis, ...],
) -> Float[Array, "p n"]:
    K = jnp.zeros((B.shape[1], B.shape[0]))
    poles = jnp.broadcast_to(poles, (len(axes), poles.shape[-1]))
    for axis, wanted in zip(axes, poles, strict=True):
        rows, motor = np.array(axis.states), axis.inputs[0]
        K = K.at[motor, rows].set(_ackermann(A[np.ix_(rows, rows)], B[rows, motor], wanted))
    return K


def _ackermann(
    A: Float[Array, "n n"], B: Float[Array, " n"], poles: Complex[Array, " n"]
) -> Float[Array, " n"]:
    n = B.size
    D = A - jnp.eye(n)
    scale = jnp.max(jnp.abs(D)) ** jnp.arange(n, dtype=A.dtype)  # of columns, each a power of D
    columns, column = [], B
    for _ in range(n):
        columns.append(column)
        column = D @ column
    reach = jnp.stack(columns, axis=1) / scale[None]
    last = jnp.linalg.solve(reach.T, jnp.zeros(n).at[-1].set(1.0)) / scale[-1]
    last, D, identity = (x.astype(poles.dtype) for x in (last, D, jnp.eye(n)))
    for q in poles - 1:
        last = last @ (D - q * identity)
    return last.real


def _check_poles(given: Complex[np.ndarray, " n"]) -> None:
    received = f"received {np.array2string(given, precision=6)}"
    if not np.all(np.abs(given) < 1):
        raise ValueError(f"poles: need to be inside the unit circle, {received}")
    if not np.allclose(np.sort_complex(given), np.sort_complex(given.conj()), rtol=0, atol=1e-9):
        raise ValueError(f"poles: complex ones need to come in pairs, {received}")
