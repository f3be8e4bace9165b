"""Spectral radius of a matrix with its derivative, and how small factorisations are batched."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Complex, Float

SHIFT = 1e-8  # relative to an eigenvalue: its matrix minus this shift can still be inverted


def in_turn(function: Callable) -> Callable:
    """The same function of arrays without derivative, whose batches are loops on a CPU.

    There JAX (0.10) spreads the LAPACK calls of a batch over the threads that run the program and
    waits for them: two batches at the same time, and it waits for ever. A loop is faster, too: one
    small problem stays in the cache.
    """
    if jax.default_backend() == "cpu":
        function = jax.custom_batching.sequential_vmap(function)
    return lambda *arrays: function(*jax.lax.stop_gradient(arrays))


def poles(M: Float[Array, "N N"]) -> Complex[Array, " N"]:
    """Eigenvalues; infinite where a matrix is not finite. Call it `in_turn`."""
    finite = jnp.isfinite(M).all()
    return jnp.where(finite, jnp.linalg.eigvals(jnp.where(finite, M, 0.0)), jnp.inf)


def radius_slope(
    M: Float[Array, "N N"], values: Complex[Array, " N"]
) -> tuple[Float[Array, ""], Float[Array, "N N"]]:
    """Spectral radius |l| of a matrix with these eigenvalues, and its derivative.

        d|l| = Re(conj(l) / |l| w'dM v / w'v),     v, w' right and left eigenvector of l.
    They are found by inverse iteration. Where the largest eigenvalue is not simple the derivative
    is that of one of them. Call it `in_turn`.
    """
    largest = values[jnp.argmax(jnp.abs(values))]
    size = jnp.abs(largest)
    finite = jnp.isfinite(size)
    M, largest = jnp.where(finite, M, 0.0), jnp.where(finite, largest, 0.0)
    N = M.shape[0]
    shift = (largest * (1 + SHIFT) + SHIFT**2) * jnp.eye(N, dtype=largest.dtype)
    factors = jax.scipy.linalg.lu_factor(M.astype(largest.dtype) - shift)
    right = left = jnp.sin(1.0 + np.arange(N)).astype(largest.dtype)  # not normal to any mode
    for _ in range(2):
        right = _unit(jax.scipy.linalg.lu_solve(factors, right))
        left = _unit(jax.scipy.linalg.lu_solve(factors, left, trans=1))
    turned = jnp.conj(unit_circle(jnp.angle(largest))) / (left @ right)
    slope = jnp.real(turned * jnp.outer(left, right))
    return size, jnp.where(jnp.isfinite(slope), slope, 0.0)


def radius(M: Float[Array, "N N"]) -> Float[Array, ""]:
    """Spectral radius with derivative; infinite where a matrix is not finite.

    >>> M = jnp.array([[0.5, 1.0], [0.0, -0.9]])
    >>> float(radius(M)), jnp.abs(jax.grad(radius)(M)).round(3).tolist()
    (0.9, [[0.0, 0.0], [0.714, 1.0]])
    """
    size, slope = in_turn(lambda M: radius_slope(M, poles(M)))(M)
    return with_slope(jax.lax.stop_gradient(size), slope, M)


def with_slope(value: Array, slope: Any, argument: Any) -> Array:
    """A value without derivative, given its derivative with respect to a tree of arrays."""
    for gradient, leaf in zip(jax.tree.leaves(slope), jax.tree.leaves(argument), strict=True):
        change = leaf - jax.lax.stop_gradient(leaf)
        change = jnp.where(jnp.isfinite(change), change, 0.0)
        value = value + jnp.sum(jax.lax.stop_gradient(gradient) * change)
    return value


def unit_circle(angle: Float[ArrayLike, "*batch"]) -> Complex[Array, "*batch"]:
    """Point exp(j angle)."""
    return jax.lax.complex(jnp.cos(angle), jnp.sin(angle))


def _unit(vector: Complex[Array, " N"]) -> Any:
    return vector / jnp.linalg.norm(vector).astype(vector.dtype)
