"""Peaks of the sensitivities of one frozen loop over all frequencies.

S_u = (I - K P)^-1 and S_y = I + P S_u K J, with plant P and controller K; J says how a change of
the positions shows in the measurement. P and K are evaluated apart, on triangular matrices (Schur
form), which is cheaper than the loop as a whole. A grid over all frequencies finds the wide peaks.
No narrow one is missed: it comes from a pair of poles r exp(+-j a) of the closed loop near the unit
circle, stands at a, is 1 - r wide, and a belongs to the grid. The highest points are refined by
parabolas in brackets ever narrower.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jcontour.analysis.frozen_loops import FrozenLoop
from jcontour.analysis.spectral import in_turn, unit_circle
from jcontour.riccati.algebraic import small_inverse

# [rad per sample]; the first stands for 0, where integrators have no response
GRID = np.pi * np.concatenate([[1e-7], np.geomspace(1e-4, 0.2, 28), np.linspace(0.2, 1, 17)[1:]])
REFINED = 4  # highest points of the grid that are refined: the highest may lie beside its peak
WIDEST = 0.02  # half a bracket around the angle of a pair of poles, in the logarithm
SPREAD = 0.05  # of a bracket, about the vertex of its parabola: it shrinks to a tenth each time
NARROWED = 4  # brackets of the highest peak after the first


class Encoding(NamedTuple):
    """How the r positions in a measurement of q numbers are read, and changed at z.

    The measurement changes by (level + (1 - 1/z) slope) d under a change d of the positions.
    """

    read: Float[np.ndarray, "r q"]
    level: Float[np.ndarray, "q r"]
    slope: Float[np.ndarray, "q r"]

    def at(self, z: Complex[Array, "*F"]) -> Complex[Array, "*F q r"]:
        """J(z) = level + (1 - 1/z) slope."""
        level, slope = (jnp.asarray(matrix, z.dtype) for matrix in (self.level, self.slope))
        later = jnp.einsum("...,qr->...qr", 1 - 1 / z, slope)
        return jnp.broadcast_to(level, later.shape) + later


class Triangular(NamedTuple):
    """A system with a triangular matrix A; as it is where there is no Schur form but LU."""

    A: Complex[Array, "n n"]
    B: Complex[Array, "n p"]
    C: Complex[Array, "q n"]

    @classmethod
    def of(cls, A: Float[Array, "n n"], B, C) -> "Triangular":
        """Schur form on a CPU."""
        if jax.default_backend() != "cpu" or not A.size:
            kind = jnp.result_type(A.dtype, jnp.complex64)
            return cls(*(matrix.astype(kind) for matrix in (A, B, C)))
        T, Q = jax.scipy.linalg.schur(A, output="complex")
        return cls(T, Q.conj().T @ B.astype(T.dtype), C.astype(T.dtype) @ Q)

    def response(self, z: Complex[Array, " F"]) -> Complex[Array, "F q p"]:
        """C (zI - A)^-1 B."""
        A, B, C = self
        n = A.shape[0]
        if n == 0:  # a controller without memory
            return jnp.zeros((z.size, C.shape[0], B.shape[1]), z.dtype)
        if jax.default_backend() != "cpu":
            one = jnp.eye(n, dtype=z.dtype)
            return jax.vmap(lambda z: C @ jnp.linalg.solve(z * one - A, B))(z)

        def substitute(k, X):
            known = jnp.einsum("j,fjp->fp", A[n - 1 - k], X) + B[n - 1 - k][None]
            return X.at[:, n - 1 - k].set(known / (z - A[n - 1 - k, n - 1 - k])[:, None])

        X = jax.lax.fori_loop(0, n, substitute, jnp.zeros((z.size, *B.shape), z.dtype))
        return jnp.einsum("qj,fjp->fqp", C, X)


class Brackets(NamedTuple):
    """Peaks between three places each, the middle one the highest; curves in axis 0.

    Attributes:
        place: logarithms of frequencies.
        height: there.
    """

    place: Float[Array, "2 R 3"]
    height: Float[Array, "2 R 3"]


class Responses(NamedTuple):
    """Plant and controller of one loop, ready for many frequencies; no derivatives."""

    plant: Triangular
    law: Triangular
    D: Float[Array, "p q"]

    @classmethod
    def of(cls, loop: FrozenLoop) -> "Responses":
        """Both in triangular form."""
        (A, B, H), (W, E, K, D) = loop
        triangular = in_turn(Triangular.of)
        return cls(triangular(A, B, H), triangular(W, E, K), jax.lax.stop_gradient(D))

    def heights(self, frequency: Float[Array, " F"], encoding: Encoding) -> Float[Array, "F 2"]:
        """Largest singular values of S and T, over input and output."""
        z = unit_circle(frequency)
        P, K = self.plant.response(z), self.D.astype(z.dtype)[None] + self.law.response(z)
        read = jnp.asarray(encoding.read, z.dtype)
        S = small_inverse(_one_plus(-K @ P))
        both = [T for T in (_one_plus(S, -1), read @ P @ S @ K @ encoding.at(z)) if T.size]
        sensitivity = [_norm(_one_plus(T)) for T in both]
        complementary = [_norm(T) for T in both]
        found = [jnp.max(jnp.stack(curve), axis=0) for curve in (sensitivity, complementary)]
        return jnp.nan_to_num(jnp.stack(found, axis=1), posinf=0.0)


def peak_frequencies(heights, poles: Complex[Array, " N"], on_grid: Float[Array, "F 2"]):
    """Frequencies [rad per sample] of the peaks of S and of T, (2,).

    Args:
        heights: (M,) frequencies -> largest singular values (M, 2) of S and T.
        poles: of the closed loop, which is stable.
        on_grid: heights on `GRID`.
    """
    places = _places(poles)
    values = jnp.concatenate([on_grid, heights(jnp.exp(places[GRID.size :]))])
    order = jnp.argsort(places)
    brackets = _highest(places[order], values[order])
    brackets = _narrowed(heights, brackets)
    best = jnp.argmax(brackets.height[..., 1], axis=1)[:, None, None]
    brackets = Brackets(*(jnp.take_along_axis(one, best, axis=1) for one in brackets))
    repeated = jax.lax.fori_loop(0, NARROWED, lambda _, one: _narrowed(heights, one), brackets)
    frequency = jnp.exp(_vertex(repeated)[:, 0])
    return jnp.where(frequency > np.pi, 2 * np.pi - frequency, frequency)


def _one_plus(G: Complex[Array, "F p p"], factor: int = 1) -> Complex[Array, "F p p"]:
    """Matrices with `factor` added on their diagonals."""
    return G + factor * jnp.eye(G.shape[1], dtype=G.dtype)[None]


def _norm(G: Complex[Array, "F p p"]) -> Float[Array, " F"]:
    """Largest singular value, in closed form up to 2 x 2."""
    if G.shape[1] == 1:
        return jnp.abs(G[:, 0, 0])
    if G.shape[1] > 2:
        return jnp.linalg.svd(G, compute_uv=False)[:, 0]
    square = jnp.sum(jnp.abs(G) ** 2, axis=1)
    cross = jnp.abs(jnp.sum(jnp.conj(G[:, :, 0]) * G[:, :, 1], axis=1))
    middle, half = (square[:, 0] + square[:, 1]) / 2, (square[:, 0] - square[:, 1]) / 2
    return jnp.sqrt(middle + jnp.sqrt(half**2 + cross**2))


def _places(poles: Complex[Array, " N"]) -> Float[Array, " F"]:
    """Logarithms of the grid, then of three frequencies for each pair of poles.

    They stand at the angle of the pair and its distance from the unit circle on either side: a
    bracket as wide as the peak.
    """
    pairs = min(poles.size // 2, GRID.size - 2)
    unused = np.sqrt(GRID[1:-1] * GRID[2:])[GRID.size - 2 - pairs :]
    angle = jnp.angle(poles)
    resonant = (jnp.imag(poles) > 0) & (angle > GRID[1])
    relative = jnp.where(resonant, (1 - jnp.abs(poles)) / jnp.where(resonant, angle, 1.0), jnp.inf)
    narrow = jnp.argsort(relative)[:pairs]
    beside = jnp.log(jnp.where(resonant[narrow], angle[narrow], unused))
    width = jnp.where(resonant[narrow], jnp.minimum(relative[narrow], WIDEST), WIDEST)
    return jnp.concatenate([np.log(GRID), beside - width, beside, beside + width])


def _highest(places: Float[Array, " F"], values: Float[Array, "F 2"]) -> Brackets:
    """Highest local maxima of both curves, (2, REFINED), and their neighbours.

    Beyond pi a curve is its own reflection.
    """
    mirrored = jnp.log(2 * np.pi - jnp.exp(places[-2:-1]))
    places = jnp.concatenate([places[:1] - 1, places, mirrored])
    values = jnp.concatenate([values[:1], values, values[-2:-1]]).T
    before, here, after = values[:, :-2], values[:, 1:-1], values[:, 2:]
    top = jnp.where((here >= before) & (here >= after), here, -jnp.inf)
    _, chosen = jax.lax.top_k(top, REFINED)
    rows = chosen[..., None] + np.arange(3)[None, None]
    heights = jnp.take_along_axis(values[:, None], rows, axis=2)
    return Brackets(places[rows], heights)


def _narrowed(heights, brackets: Brackets) -> Brackets:
    """Brackets around the highest of the points known and three more about the vertex."""
    width = brackets.place[..., 2] - brackets.place[..., 0]
    middle = _vertex(brackets)[..., None]
    spread = SPREAD * width[..., None] * np.array([[[-1.0, 0.0, 1.0]]])
    low, high = brackets.place[..., :1], brackets.place[..., 2:]
    places = jnp.clip(middle + spread, low, high)
    both = heights(jnp.exp(places).ravel()).reshape(*places.shape, 2)
    levels = jnp.stack([both[k, ..., k] for k in range(2)])
    places = jnp.concatenate([brackets.place, places], axis=2)
    levels = jnp.concatenate([brackets.height, levels], axis=2)
    order = jnp.argsort(places, axis=2)
    places, levels = (jnp.take_along_axis(one, order, axis=2) for one in (places, levels))
    best = jnp.clip(jnp.argmax(levels, axis=2, keepdims=True), 1, 4)
    rows = best + np.array([[[-1, 0, 1]]])
    return Brackets(*(jnp.take_along_axis(one, rows, axis=2) for one in (places, levels)))


def _vertex(brackets: Brackets) -> Float[Array, "2 R"]:
    """Vertex of the parabola through three points; never the middle one itself."""
    a, b, c = (brackets.place[..., k] for k in range(3))
    low, top, high = (brackets.height[..., k] for k in range(3))
    left, right = (top - low) * (c - b), (top - high) * (b - a)
    area = left + right
    step = (left * (c - b) - right * (b - a)) / jnp.where(area > 0, 2 * area, 1.0)
    least = 1e-3 * SPREAD * jnp.where(c - b > b - a, 1.0, -1.0) * (c - a)
    return b + jnp.where(jnp.abs(step) > jnp.abs(least), step, least)
