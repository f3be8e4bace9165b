"""The receding-horizon sweep with time on the last axis, and its gradient along predicted trajectories.

The state carries a 1 behind it, so that H holds g in its last column, K = [F, -f] and Q = [[Q, -Q
y_d], [-y_d' Q, .]]. With M = [A B], one stage back is a product with constant matrices and an
elimination of the p inputs:
    Hz = M' H_{j+1} M,   G = (Hz_uu + R)^-1,   K_j = G Hz_ux,   H_j = Hz_xx - Hz_xu K_j + C' Q_j C
Hz is linear in H: its upper triangle, for all steps at once, is one matrix product for every two
axes that nothing couples.

Derivative: at the optimum the gains do not move the cost. With the closed loop A_j = A - B K_j,
    dH_j = A_j' dH_{j+1} A_j + K_j' dR K_j + C' dQ_j C,   dK_0 = G (B' dH_1 A_0 - dR K_0)
so a cotangent Kbar of K_0 reaches stage j as two bundles of p predicted trajectories instead of a
matrix of H's size:
    U_1 = B G,  V_1 = A_0 Kbar',  U_{j+1} = A_j U_j,  V_{j+1} = A_j V_j;   Qbar_j = C U_j V_j' C',
    Rbar += K_j U_j V_j' K_j'
"""

from functools import lru_cache, partial, reduce
from itertools import combinations_with_replacement, product
from operator import add
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float, Int, Shaped

from jcontour.linear.plant import Pattern, decoupled_axes

BLOCK = 512  # steps swept together: their numbers stay in a core's second-level cache

# row and column of entries of a symmetric matrix, each entry once
Entries = Int[np.ndarray, "2 _"]


class Block(NamedTuple):
    """The entries of Hz that belong to two axes, those of H first, and the entries of Q that reach them."""

    entries: Entries
    of_H: Entries
    weighed: Int[np.ndarray, " q"]


class Packing(NamedTuple):
    """Which entries of Hz are kept, and where. States count from 0 in this order, the 1 is n, inputs count from n + 1.

    Attributes:
        order: the states, axis by axis.
        blocks: one for every two axes, then one for the column of g.
        rows: for every input, the pieces (block, first, last) of its row of Hz_ux.
        square: for every two inputs, the place (block, row) of their entry of Hz_uu.
    """

    order: Int[np.ndarray, " n"]
    blocks: tuple[Block, ...]
    rows: tuple[tuple[tuple[int, int, int], ...], ...]
    square: dict[tuple[int, int], tuple[int, int]]


class Problem(NamedTuple):
    """The data of the sweep besides the model; `cost` has the entries of [Q, -Q y_d] of every sample."""

    cost: Float[Array, "q S"]
    stage: Float[Array, " N_p"]
    R: Float[Array, "p p"]
    H: Float[Array, "T n n"]
    g: Float[Array, "T n"]


class Gains(NamedTuple):
    """K_0, the K_j of the later stages (last stage first), and G of the first control."""

    first: Float[Array, "p n+1 T"]
    later: Float[Array, "N_p-1 p n+1 T"]
    G: Float[Array, "p p T"]


def window_plan(
    pattern: Pattern, A, B, C, Q, y_d, stage, R, H, g
) -> tuple[Float[Array, "T p n"], Float[Array, "T p"]]:
    """F, f of `riccati.receding_horizon_plan`. Q, R and H have to be symmetric; where the pattern is False, the model has to be zero."""
    m, preview = C.shape[0], stage.shape[0]
    Q = [[(Q[:, a, b] + Q[:, b, a]) / 2 for b in range(m)] for a in range(m)]
    cost = jnp.stack(
        [
            Q[a][b] if b < m else -sum(Q[a][c] * y_d[:, c] for c in range(m))
            for a, b in seen_entries(m).T
        ]
    )
    steps = cost.shape[1] - preview
    count = -(-steps // max(BLOCK, 2 * preview))
    if count == 1:
        return _plan(pattern, A, B, C, Problem(cost, stage, R, H, g))
    length = -(-steps // count)
    idle = count * length - steps  # steps without cost, swept to make the blocks equal

    def cut(values):
        return jnp.pad(values, ((0, idle), *[(0, 0)] * (values.ndim - 1))).reshape(
            count, length, *values.shape[1:]
        )

    cost = jnp.pad(cost, ((0, 0), (0, idle)))
    own, end = cost[:, : count * length].reshape(-1, count, length), cost[:, None, count * length :]
    ahead = jnp.concatenate([own[:, 1:, :preview], end], axis=1)
    windows = jnp.concatenate([own, ahead], axis=2).swapaxes(0, 1)

    def plan(block):
        window, H, g = block
        return _plan(pattern, A, B, C, Problem(window, stage, R, H, g))

    F, f = jax.lax.map(plan, (windows, cut(H), cut(g)))
    return F.reshape(-1, *F.shape[2:])[:steps], f.reshape(-1, *f.shape[2:])[:steps]


def seen_entries(outputs: int) -> Entries:
    """Entries of Q with the column -Q y_d, in the order of `Problem.cost`."""
    return np.array(list(combinations_with_replacement(range(outputs + 1), 2))[:-1]).T


@lru_cache
def packing(pattern: Pattern) -> Packing:
    """The packing of all plants with one pattern."""
    axes = [axis for axis in decoupled_axes(pattern) if axis.states or axis.inputs]
    order = np.array([state for axis in axes for state in axis.states])
    n, p, m = len(order), len(pattern.B[0]), len(pattern.C)
    ends = np.cumsum([0] + [len(axis.states) for axis in axes])
    parts = [
        (range(ends[a], ends[a + 1]), [n + 1 + u for u in axis.inputs])
        for a, axis in enumerate(axes)
    ]
    everything, one = (range(n), range(n + 1, n + 1 + p)), (range(n, n + 1), [])
    C = np.zeros((m + 1, n + 1), int)
    C[:m, :n], C[m, n] = np.array(pattern.C)[:, order], 1
    blocks, place = [], {}
    for (x, u), (y, v) in [*combinations_with_replacement(parts, 2), (everything, one)]:
        own = x is y
        of_H = list(combinations_with_replacement(x, 2) if own else product(x, y))
        mixed = [(i, w) for w in v for i in x] + ([] if own else [(i, w) for w in u for i in y])
        of_inputs = list(combinations_with_replacement(u, 2) if own else product(u, v))
        entries = of_H + mixed + of_inputs
        place |= {entry: (len(blocks), row) for row, entry in enumerate(entries)}
        entries, of_H = (np.array(some, int).reshape(-1, 2).T for some in (entries, of_H))
        blocks.append(
            Block(entries, of_H, np.flatnonzero(congruence(C, of_H, seen_entries(m)).any(0)))
        )
    place |= {(v, u): there for (u, v), there in place.items() if u > n}
    rows = [
        [(*place[x[0], u], place[x[-1], u][1] + 1) for x, _ in [*parts, one] if x]
        for u in everything[1]
    ]
    square = {(u - n - 1, v - n - 1): place[u, v] for u, v in product(everything[1], repeat=2)}
    return Packing(order, tuple(blocks), tuple(map(tuple, rows)), square)


def congruence(
    M: Shaped[Array | np.ndarray, "rows columns"],
    of_product: Int[np.ndarray, "2 s"],
    of_X: Int[np.ndarray, "2 r"],
) -> Shaped[Array | np.ndarray, "s r"]:
    """Matrix that takes entries of a symmetric X to entries of M' X M."""
    (i, j), (a, b) = of_product[:, :, None], of_X
    return M[a, i] * M[b, j] + (a != b).astype(M.dtype)[None] * M[b, i] * M[a, j]


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _plan(pattern: Pattern, A, B, C, problem: Problem):
    return _in_time(pattern, _sweep(pattern, _maps(pattern, A, B, C), problem))


@partial(_plan.defjvp, symbolic_zeros=True)
def _plan_jvp(pattern: Pattern, primals, tangents):
    *model, problem = primals
    if not all(
        _still(tangent) for tangent in tangents[:3]
    ):  # a model that is identified: differentiate the sweep itself
        tangents = jax.tree.map(
            lambda t: jnp.zeros(t.shape, t.dtype) if _still(t) else t, tangents, is_leaf=_still
        )
        return jax.jvp(
            lambda A, B, C, q: _in_time(pattern, _sweep(pattern, _maps(pattern, A, B, C), q)),
            primals,
            tangents,
        )
    moved = {
        name: t for name, t in tangents[3]._asdict().items() if t is not None and not _still(t)
    }
    maps = _maps(pattern, *model)
    gains = _sweep(pattern, maps, problem)
    plan = _in_time(pattern, gains)

    @jax.jit  # traced once, used three times
    def forward(moved):
        start = {name: getattr(problem, name) for name in moved}
        return jax.jvp(
            lambda some: _in_time(pattern, _sweep(pattern, maps, problem._replace(**some))),
            (start,),
            (moved,),
        )[1]

    def backward(cotangent):
        bar = _trajectories(pattern, *model, problem, gains, *cotangent)
        return {name: getattr(bar, name) for name in moved}

    return plan, linear_map(forward, backward, moved, plan) if moved else jax.tree.map(
        jnp.zeros_like, plan
    )


def _still(tangent) -> bool:
    return isinstance(tangent, SymbolicZero)


def linear_map(forward, backward, x, like):
    """forward(x), shaped as `like`, with `backward` as its transpose.

    It is a corner of the inverse of [[I, 0], [-forward, I]], so that JAX's linear solve brings vmap
    and all derivatives with it.
    """

    def plus(first, second):
        return jax.tree.map(jnp.add, first, second)

    nothing = jnp.sum(
        jax.tree.leaves(x)[0].ravel()[:0]
    )  # zero, but linear in x, as all of a right-hand side has to be
    return jax.lax.custom_linear_solve(
        lambda z: (z[0], jax.tree.map(jnp.subtract, z[1], forward(z[0]))),
        (
            x,
            jax.tree.map(
                lambda entry: jnp.broadcast_to(nothing.astype(entry.dtype), entry.shape), like
            ),
        ),
        lambda _, z: (z[0], plus(z[1], forward(z[0]))),
        lambda _, z: (plus(z[0], backward(z[1])), z[1]),
    )[1]


def _in_time(pattern: Pattern, gains: Gains):
    """F, f with time in front and the states in the plant's order."""
    back = np.argsort(packing(pattern).order)
    return gains.first[:, back].transpose(2, 0, 1), -gains.first[:, -1].T


def _extended(order, A, B, C):
    """A, B, C with the states in the packing's order and the 1 behind them."""

    def bordered(M):
        corner = np.zeros(np.add(M.shape, 1), M.dtype)
        corner[-1, -1] = 1
        return jnp.pad(M, (0, 1)) + corner

    return bordered(A[order][:, order]), jnp.pad(B[order], ((0, 1), (0, 0))), bordered(C[:, order])


def _maps(pattern: Pattern, A, B, C) -> list[tuple[Float[Array, "z h"], Float[Array, "h q"]]]:
    """For every block the matrix that takes H to Hz, and the one that takes Q to C' Q C."""
    pack = packing(pattern)
    A, B, C = _extended(pack.order, A, B, C)
    M, seen = jnp.concatenate([A, B], axis=1), seen_entries(C.shape[0] - 1)
    return [
        (
            congruence(M, block.entries, block.of_H),
            congruence(C, block.of_H, seen[:, block.weighed]),
        )
        for block in pack.blocks
    ]


def _sweep(pattern: Pattern, maps, problem: Problem) -> Gains:
    pack = packing(pattern)
    p, preview = problem.R.shape[0], problem.stage.shape[0]
    steps = problem.cost.shape[1] - preview

    def control(H):
        Hz = [ahead @ h for (ahead, _), h in zip(maps, H, strict=True)]
        Hux = [jnp.concatenate([Hz[c][first:last] for c, first, last in row]) for row in pack.rows]
        Huu = [
            [Hz[c][row] + problem.R[u, v] for v in range(p) for c, row in [pack.square[u, v]]]
            for u in range(p)
        ]
        G = small_inverse(Huu)
        return Hz, Hux, [reduce(add, (G[u][v] * Hux[v] for v in range(p))) for u in range(p)], G

    def weight(j, scale):
        cost = scale * jax.lax.dynamic_slice_in_dim(problem.cost, j, steps, axis=1)
        rows = [cost[block.weighed] for block in pack.blocks]
        # a product with one row fuses, a matmul does not
        return [
            source * row if len(row) == 1 else source @ row
            for (_, source), row in zip(maps, rows, strict=True)
        ]

    def back(H, stage):
        Hz, Hux, K, _ = control(H)
        H = []
        for hz, cost, block in zip(Hz, weight(*stage), pack.blocks, strict=True):
            i, k = block.of_H
            H.append(hz[: i.size] - reduce(add, (Hux[u][i] * K[u][k] for u in range(p))) + cost)
        return H, jnp.stack(K)

    place = np.append(pack.order, pack.order.size)
    end = jnp.concatenate([problem.H, problem.g[:, :, None]], axis=2)
    H = [end[:, place[i], place[k]].T for i, k in (block.of_H for block in pack.blocks)]
    H, later = jax.lax.scan(back, H, (jnp.arange(preview - 1, 0, -1), problem.stage[:-1][::-1]))
    _, _, K, G = control(H)
    return Gains(jnp.stack(K), later, jnp.stack([jnp.stack(row) for row in G]))


def small_inverse(M: list[list[Array]]) -> list[list[Array]]:
    """Inverse of a positive definite matrix whose entries are vectors over time: Gauss-Jordan, which needs no pivots then."""
    for k in range(len(M)):
        pivot = 1 / M[k][k]
        row = [pivot if j == k else entry * pivot for j, entry in enumerate(M[k])]
        M = [
            row
            if i == k
            else [-old[k] * pivot if j == k else old[j] - old[k] * row[j] for j in range(len(M))]
            for i, old in enumerate(M)
        ]
    return M


def _trajectories(
    pattern: Pattern, A, B, C, problem: Problem, gains: Gains, F_bar, f_bar
) -> Problem:
    """Cotangents of the problem, from those of the plan."""
    pack = packing(pattern)
    A, B, C = _extended(pack.order, A, B, C)
    (size, p), preview = B.shape, problem.stage.shape[0]
    steps = problem.cost.shape[1] - preview
    # takes (W, K W) to the next W, to C W and to K W itself: XLA would otherwise compute K W again
    # for every use
    along = jnp.concatenate(
        [
            jnp.concatenate([A, -B], axis=1),
            jnp.pad(C, ((0, 0), (0, p))),
            jnp.eye(p, size + p, size, A.dtype),
        ]
    )

    def through(matrix, W):
        return (matrix @ W.reshape(W.shape[0], -1)).reshape(-1, *W.shape[1:])

    def control(K, W):
        return reduce(add, (K[:, i, None] * W[i] for i in range(size)))

    def paired(U, V):
        return reduce(add, (U[:, None, c] * V[None, :, c] for c in range(p)))

    def weigh(Q_bar, CW, j, scale):
        U, V = CW[:, :p], CW[:, p:]
        rows = jnp.stack(
            [
                jnp.sum(U[a] * V[b] + (U[b] * V[a] if a != b else 0), axis=0)
                for a, b in seen_entries(C.shape[0] - 1).T
            ]
        )
        scale_bar = jnp.sum(rows * jax.lax.dynamic_slice_in_dim(problem.cost, j, steps, axis=1))
        before = jax.lax.dynamic_slice_in_dim(Q_bar, j, steps, axis=1)
        return jax.lax.dynamic_update_slice_in_dim(
            Q_bar, before + scale * rows, j, axis=1
        ), scale_bar

    def step(carry, stage):
        W, Q_bar, R_bar = carry
        j, scale = stage
        K = later[(preview - 1 - j) * p * size + np.arange(p * size)].reshape(
            p, size, steps
        )  # a slice would be fused, and not vectorised
        W = through(along, jnp.concatenate([W[:size], control(K, W)]))
        Q_bar, scale_bar = weigh(Q_bar, W[size:-p], j, scale)
        return (W, Q_bar, R_bar + paired(W[-p:, :p], W[-p:, p:])), scale_bar

    K_bar = jnp.concatenate([F_bar[:, :, pack.order], -f_bar[:, :, None]], axis=2).transpose(
        2, 1, 0
    )
    KK_bar = control(gains.first, K_bar)
    U, V = (
        jnp.pad(through(B, gains.G), ((0, C.shape[0] + p), (0, 0), (0, 0))),
        through(along, jnp.concatenate([K_bar, KK_bar])),
    )
    carry = jnp.concatenate([U, V], axis=1), jnp.zeros_like(problem.cost), -paired(gains.G, KK_bar)
    later = (gains.later if preview > 1 else gains.first).reshape(
        -1, steps
    )  # N_p = 1 has none, and a gather wants a row to look at
    (W, Q_bar, R_bar), stage_bar = jax.lax.scan(
        step, carry, (jnp.arange(1, preview), problem.stage[:-1])
    )
    back = np.argsort(pack.order)
    end_bar = paired(W[:size, :p], W[:size, p:])
    H_bar, g_bar = (
        (end_bar + end_bar.swapaxes(0, 1))[back][:, back].transpose(2, 0, 1) / 2,
        end_bar[back, -1].T,
    )
    return Problem(Q_bar, jnp.append(stage_bar, 0), jnp.sum(R_bar, axis=-1), H_bar, g_bar)
