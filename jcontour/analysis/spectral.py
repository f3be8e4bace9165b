"""Spectral radius of matrices with its derivative.

Eigenvalues are found on the host, by LAPACK: XLA has none for a general matrix but on a CPU, and
there JAX (0.10) spreads the LAPACK calls of a batch over the threads that run the program and waits
for them: two batches at the same time, and it waits for ever.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

SHIFT = 1e-8  # relative to an eigenvalue: its matrix minus this shift can still be inverted


class Dominant(NamedTuple):
    """Eigenvalues of matrices, the largest modulus, and its derivative Re(left' dM right)."""

    values: Complex[np.ndarray, "*loops N"]
    radius: Float[np.ndarray, "*loops"]
    left: Complex[np.ndarray, "*loops N"]
    right: Complex[np.ndarray, "*loops N"]


def dominant(M: Float[np.ndarray, "*loops N N"]) -> Dominant:
    """Largest eigenvalue l of finite matrices, on the host.

        d|l| = Re(conj(l) / |l| w'dM v / w'v),     v, w' right and left eigenvector of l.
    They are found by inverse iteration. Where the largest eigenvalue is not simple the derivative
    is that of one of them.
    """
    N = M.shape[-1]
    values = np.linalg.eigvals(M).astype(complex)
    chosen = np.argmax(np.abs(values), axis=-1)[..., None]
    largest = np.take_along_axis(values, chosen, axis=-1)[..., 0]
    shift = largest * (1 + SHIFT) + SHIFT**2
    inverse = np.linalg.inv(M - shift[..., None, None] * np.eye(N))
    first = np.broadcast_to(np.sin(1.0 + np.arange(N)), M.shape[:-1])  # not normal to any mode
    right = left = first.astype(complex)
    for _ in range(2):
        right = _unit((inverse @ right[..., None])[..., 0])
        left = _unit((left[..., None, :] @ inverse)[..., 0, :])
    with np.errstate(all="ignore"):  # a nilpotent matrix has no slope
        turned = np.exp(-1j * np.angle(largest)) / np.sum(left * right, axis=-1)
        left = np.nan_to_num(turned[..., None] * left, nan=0.0, posinf=0.0, neginf=0.0)
    return Dominant(values, np.abs(largest), left, right)


def radius(M: Float[Array, "*batch N N"]) -> Float[Array, "*batch"]:
    """Spectral radius with derivative; infinite where a matrix is not finite.

    >>> M = jnp.array([[0.5, 1.0], [0.0, -0.9]])
    >>> float(radius(M)), jnp.abs(jax.grad(radius)(M)).round(3).tolist()
    (0.9, [[0.0, 0.0], [0.714, 1.0]])
    """
    like = jax.ShapeDtypeStruct(M.shape[:-2], M.dtype), jax.ShapeDtypeStruct(M.shape, M.dtype)
    size, slope = on_host(_radius, like, M)
    return with_slope(size, slope, M)


def on_host(function: Callable, like: Any, *arguments: Any) -> Any:
    """Answer of a function of NumPy arrays, batched in front; without derivative.

    Args:
        function: arrays -> arrays.
        like: shapes and types of its answer.
        arguments: pytrees of arrays.
    """
    arguments = jax.lax.stop_gradient(arguments)
    return jax.pure_callback(function, like, *arguments, vmap_method="broadcast_all")


@jax.jit
def with_slope(value: Array, slope: Any, argument: Any) -> Array:
    """A value without derivative, given its derivative with respect to a tree of matrices."""
    for gradient, leaf in zip(jax.tree.leaves(slope), jax.tree.leaves(argument), strict=True):
        change = leaf - jax.lax.stop_gradient(leaf)
        change = jnp.where(jnp.isfinite(change), change, 0.0)
        value = value + jnp.sum(gradient * change, axis=(-2, -1))
    return value


def times(matrix: Array | np.ndarray, vector: Array | np.ndarray) -> Any:
    """Matrices (..., a, b) times vectors (..., b)."""
    return (matrix @ vector[..., None])[..., 0]


def real_outer(a: Array | np.ndarray, b: Array | np.ndarray) -> Float[np.ndarray, "*loops a b"]:
    """Real part of a b' for vectors in batches that go together."""
    return np.real(a[..., :, None] * b[..., None, :])


def _radius(M: Any) -> tuple[np.ndarray, np.ndarray]:
    M = np.asarray(M)
    finite = np.isfinite(M).all(axis=(-2, -1))
    _, size, left, right = dominant(np.where(finite[..., None, None], M, 0.0).astype(float))
    slope = np.real(left[..., :, None] * right[..., None, :])
    size = np.where(finite, size, np.inf)
    slope = np.where(finite[..., None, None], slope, 0.0)
    return size.astype(M.dtype), slope.astype(M.dtype)


def _unit(vector: Complex[np.ndarray, "*loops N"]) -> Any:
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)
