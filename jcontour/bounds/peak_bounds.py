"""Largest values of signals under bounded disturbances: exact, by adjoint sweeps.

    z(k+1) = M(k) z(k) + E(k) w(k),   z(0) = 0,   |w_i(k)| <= size_i
    e(k) = c(k)' z(k) + d(k)' w(k)
    sup |e(k)| = sum_i |d(k)|_i size_i + sum_{j<k} sum_i |c(k)' M(k-1) ... M(j+1) E(j)|_i size_i
It is the maximum of a linear function over a box, and w = size sign(.) reaches it. All samples k
sweep back together, one lag at a time.

A long run is cut into blocks. The sweep of a sample ends where the block before its own begins, at
the sample b; there the state lies in a box |z(b)| <= V, found by the same sweep. So

    sup |e(k)| <= sum over j >= b  +  |c(k)' M(k-1) ... M(b)| V
which bounds the exact value from above; both are the same where there is one block.

The adjoint of one signal carries its row back from a sample k to the begin: the attack

    w(j) = size sign(c' M(k-1) ... M(j+1) E(j)) sign(e(k) without disturbance)
makes it as large as it can be there.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.bounds.disturbed_loop import Box, DisturbedLoop
from jcontour.plant import Plant
from jcontour.plants.actuation import Disturbed

SHORTEST_BLOCK = 32  # samples
LOOKED_AT = 32  # frozen loops: eigenvalues of all would take as long as the sweep
REMAINDER = 1e-10  # of the largest bound, that the state at a block's begin may add


class PeakBounds(NamedTuple):
    """Largest absolute value of every signal at every sample.

    Attributes:
        bound: proven; nothing within the box exceeds it.
        remainder: the part of it that is not reached by a disturbance of the sweep.
    """

    bound: Float[np.ndarray, "T r"]
    remainder: Float[np.ndarray, "T r"]


def peak_bounds(
    loop: DisturbedLoop,
    rows: Float[Array | np.ndarray, "T r N"],
    size: Float[np.ndarray, " d"],
    direct: Float[Array | np.ndarray, "T r d"] | None = None,
    block: int | None = None,
) -> PeakBounds:
    """Largest absolute values of the signals c(k)' z(k) + d(k)' w(k) over all disturbances.

    Args:
        loop: along its run; the state is not disturbed at its begin.
        rows: c(k), one for each signal.
        size: of the box.
        direct: d(k); zero when not given.
        block: samples of a block; when not given, as many as make the remainder negligible.

    Raises:
        ValueError: the block has no sample, or shapes do not go together.
    """
    T, N, d = loop.E.shape
    if rows.shape[0] != T or rows.shape[2] != N or size.shape != (d,):
        raise ValueError(
            f"rows, size: the loop needs shapes ({T}, r, {N}) and ({d},), "
            f"received {rows.shape} and {size.shape}"
        )
    if block is not None:
        if block < 1:
            raise ValueError(f"block: needs at least one sample, received {block}")
        return _blocked(loop, rows, size, direct, min(block, T))
    # samples after which the slowest of some frozen loops has forgotten: a power of two
    some = slice(None, None, max(1, T // LOOKED_AT))
    frozen = loop._replace(M=loop.M[some], E=loop.E[some])
    radius = float(np.clip(frozen.radius().max(), 1e-3, 1 - 1e-9))
    forgotten = max(np.log(REMAINDER) / np.log(radius), SHORTEST_BLOCK)
    samples = 2 ** int(np.ceil(np.log2(forgotten)))
    while True:
        peaks = _blocked(loop, rows, size, direct, min(samples, T))
        if samples >= T or peaks.remainder.max() <= REMAINDER * peaks.bound.max():
            return peaks
        samples *= 2


def state_tubes(
    loop: DisturbedLoop, size: Float[np.ndarray, " d"], block: int
) -> Float[np.ndarray, "B N"]:
    """Largest absolute value of every entry of the state at the begin of every block.

    The first is zero. Every other one is that of the sweep over the block before, and of what the
    state at its begin adds.
    """
    T, N = loop.E.shape[:2]
    begins = np.arange(0, T, block)
    unit = np.broadcast_to(np.eye(N), (begins.size, 1, N, N))
    sums, carried = (np.asarray(part)[:, 0] for part in _swept(loop.M, loop.E, size, unit, block))
    tubes = np.zeros((begins.size, N))
    for b in range(1, begins.size):
        tubes[b] = sums[b] + np.abs(carried[b]) @ tubes[b - 1]
    return tubes


def _blocked(loop: DisturbedLoop, rows, size, direct, block: int) -> PeakBounds:
    T = loop.E.shape[0]
    before = np.maximum(np.arange(T) // block - 1, 0)
    tubes = state_tubes(loop, size, block)[before]
    after = -T % block
    blocks = np.pad(np.asarray(rows), ((0, after), (0, 0), (0, 0)))
    blocks = blocks.reshape(-1, block, *blocks.shape[1:])
    swept = _swept(loop.M, loop.E, size, blocks, block)
    sums, carried = (np.concatenate(np.asarray(peaks))[:T] for peaks in swept)
    remainder = np.einsum("trn,tn->tr", np.abs(carried), tubes)
    peaks = sums + remainder
    if direct is not None:
        peaks = peaks + np.abs(np.asarray(direct)) @ size
    return PeakBounds(peaks, remainder)


@jax.jit(static_argnums=4)
def _swept(
    M: Float[Array, "T N N"],
    E: Float[Array, "T N d"],
    size: Float[Array, " d"],
    rows: Float[Array, "B K r N"],
    block: int,
) -> tuple[Float[Array, "B K r"], Float[Array, "B K r N"]]:
    """Sums back to the begin of the block before, and the rows carried back to there."""
    # all rows of a block pass the same matrices: a step is one product for all of them; a row joins
    # at its own sample; beyond both ends of the run the state rests
    T, N = E.shape[:2]
    count, joining = rows.shape[:2]
    rest = jnp.broadcast_to(jnp.eye(N, dtype=M.dtype), (block, N, N))
    after = count * block - T
    M = jnp.concatenate([rest, M, rest[:after]])
    E = jnp.pad(E * size[None, None], ((block, after), (0, 0), (0, 0)))

    def of_block(b):
        own = rows[b]

        def back(carry, j):
            moving, sums = carry
            joins, k = j + 1 - block, b * block + j
            at = jnp.maximum(joins, 0)
            moving = moving.at[at].set(jnp.where(joins < 0, moving[at], own[at]))
            sums = sums + jnp.sum(jnp.abs(moving @ E[k]), axis=-1)
            return (moving @ M[k], sums), None

        start = jnp.zeros_like(own), jnp.zeros(own.shape[:2], own.dtype)
        first = jnp.arange(block - 1 + joining)  # samples from the begin of the block before
        return jax.lax.scan(back, start, first, reverse=True)[0]

    moving, sums = jax.lax.map(of_block, jnp.arange(count))
    return sums, moving


class Attack(NamedTuple):
    """Disturbances of every sample, inside the box; zero from the attacked sample on."""

    force: Float[np.ndarray, "T p"]  # adds to the control
    noise: Float[np.ndarray, "T q"]  # adds to the measurement [m]

    def on(self, plant: Plant) -> Disturbed:
        """The plant under this attack."""
        return Disturbed(plant, force=jax.device_put(self.force), noise=jax.device_put(self.noise))


def coefficients(
    loop: DisturbedLoop, row: Float[Array | np.ndarray, " N"], sample: int
) -> Float[np.ndarray, "k d"]:
    """Effect of every disturbance before a sample on the signal row' z(sample).

        e(k) = sum_j coefficients(j)' w(j)

    Raises:
        ValueError: there is no such sample.
    """
    T = loop.E.shape[0]
    if not 0 <= sample < T:
        raise ValueError(f"sample: needs one from 0 to {T - 1}, received {sample}")
    M, E = np.asarray(loop.M), np.asarray(loop.E)
    rows, adjoint = np.zeros((sample, E.shape[2])), np.asarray(row)
    for j in range(sample - 1, -1, -1):
        rows[j] = adjoint @ E[j]
        adjoint = adjoint @ M[j]
    return rows


def worst_attack(
    loop: DisturbedLoop, row: Float[Array | np.ndarray, " N"], sample: int, box: Box, sign: float
) -> Attack:
    """Attack under which the signal row' z(sample) is largest in the direction of `sign`.

    >>> from jcontour.plants import bridgeport
    >>> import jax.numpy as jnp
    >>> M, E = 0.5 * jnp.ones((3, 1, 1)), jnp.ones((3, 1, 1))
    >>> none = jnp.zeros((3, 1, 0))
    >>> loop = DisturbedLoop(M, E, M, M, none, M[0], M[0])
    >>> worst_attack(loop, jnp.ones(1), 2, Box.of(0.1, 0.0, 1, 0), -1.0).force.ravel().tolist()
    [-0.1, -0.1, 0.0]

    Raises:
        ValueError: there is no such sample.
    """
    inputs = box.force.size
    attack = np.zeros((loop.E.shape[0], box.size.size))
    pushed = np.sign(coefficients(loop, row, sample))
    attack[:sample] = np.where(sign < 0, -1.0, 1.0) * pushed * box.size
    return Attack(attack[:, :inputs], attack[:, inputs:])
