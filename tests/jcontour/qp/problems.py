"""Random problems over stages, and the same worked out in NumPy without stages."""

import jax
import numpy as np

from jcontour.qp.problem import QP
from jcontour.qp.staged import StagedQP


def staged_problems(seed, batch, stages, states, controls, rows=0):
    """Problems in a batch: a box around the controls, and rows that hold without any control."""
    random = np.random.default_rng(seed)
    n, p, v = states, controls, states + controls
    A = random.standard_normal((batch, n, n))
    A *= (random.uniform(0.5, 1.05, batch) / _radius(A))[:, None, None]
    B, x0 = random.standard_normal((batch, n, p)), random.standard_normal((batch, n))
    c = 0.1 * random.standard_normal((batch, stages, n))
    root = random.standard_normal((batch, stages + 1, v, v))
    H = root @ root.swapaxes(-1, -2) / v + 0.05 * np.eye(v)
    h = 3 * random.standard_normal((batch, stages + 1, v))
    box = np.broadcast_to(np.eye(p, v, k=n), (batch, p, v))
    D = np.concatenate([box, random.standard_normal((batch, rows, v))], axis=1)
    room = random.exponential(0.7, (2, batch, stages, p + rows)) + 0.02
    x, around = x0, np.zeros((batch, stages, p + rows))
    for j in range(stages):
        around[:, j] = np.einsum("brn,bn->br", D[:, :, :n], x)
        x = np.einsum("bij,bj->bi", A, x) + c[:, j]
    upper = around + room[0]
    lower = np.where(random.random(room[1].shape) < 0.2, -np.inf, around - room[1])
    never = np.full((batch, p + rows), np.inf)
    ends = H[:, -1, :n, :n], h[:, -1, :n]
    parts = (A, B, c, x0, H[:, :-1], h[:, :-1], *ends, D, lower, upper, never)
    return StagedQP(*parts)


def _radius(A):
    return np.abs(np.linalg.eigvals(A)).max(axis=-1)


def condensed(qp: StagedQP) -> tuple[QP, np.ndarray, np.ndarray]:
    """(problem in the controls alone and a slack for each row that gives way, F, G).

    The stages are F + G z.
    """
    A, B, c, x0, H, h, H_end, h_end, D, lower, upper, penalty = map(np.asarray, qp)
    N, (n, p) = len(h), B.shape
    Fx, Gx = np.zeros((N + 1, n)), np.zeros((N + 1, n, N, p))
    Fx[0] = x0
    for j in range(N):
        Fx[j + 1], Gx[j + 1] = A @ Fx[j] + c[j], np.einsum("ij,j...->i...", A, Gx[j])
        Gx[j + 1, :, j] += B
    Gx = Gx.reshape(N + 1, n, N * p)
    Gu = np.eye(N * p).reshape(N, p, N * p)
    F = np.concatenate([Fx[:-1], np.zeros((N, p))], axis=1)
    G = np.concatenate([Gx[:-1], Gu], axis=1)
    big = np.einsum("jaz,jab,jbw->zw", G, H, G) + Gx[-1].T @ H_end @ Gx[-1]
    small = np.einsum("jaz,ja->z", G, np.einsum("jab,jb->ja", H, F) + h)
    small = small + Gx[-1].T @ (H_end @ Fx[-1] + h_end)
    C, free = (D @ G).reshape(-1, N * p), (F @ D.T).ravel()
    low, high = lower.ravel() - free, upper.ravel() - free
    price = np.tile(penalty, N)
    gives = np.flatnonzero(np.isfinite(price))
    slack = np.eye(len(price))[:, gives]
    none = np.zeros((len(gives), len(gives)))
    zeros = np.zeros((len(small), len(gives)))
    H_all = np.block([[0.5 * (big + big.T), zeros], [zeros.T, none]])
    rows = np.concatenate([np.hstack([C, -slack]), np.hstack([C, slack])])
    lower_rows = np.concatenate([np.full(len(low), -np.inf), low])
    upper_rows = np.concatenate([high, np.full(len(high), np.inf)])
    least = np.concatenate([np.full(len(small), -np.inf), np.zeros(len(gives))])
    actual = QP(
        H_all,
        np.concatenate([small, price[gives]]),
        rows,
        lower_rows,
        upper_rows,
        least,
        np.full(len(least), np.inf),
    )
    return actual, F, G


def kkt(qp: StagedQP, controls, multipliers) -> np.ndarray:
    """Largest scaled fault of the conditions of optimality of a batch with hard limits.

    Violation over the limits' width, slope of the Lagrangian over its largest term, multipliers
    times slacks over the terms of the cost.
    """
    A, B, c, x0, H, h, H_end, h_end, D, lower, upper, _ = map(np.asarray, qp)
    u, force = np.asarray(controls), np.asarray(multipliers)
    (_, N, _), n = u.shape, A.shape[1]
    x = [x0]
    for j in range(N):
        x.append(np.einsum("bij,bj->bi", A, x[j]) + np.einsum("bij,bj->bi", B, u[:, j]) + c[:, j])
    v = np.concatenate([np.stack(x[:-1], axis=1), u], axis=2)
    value = np.einsum("brv,bjv->bjr", D, v)
    over = np.stack([value - upper, lower - value], axis=1)
    there = np.isfinite(over)
    width = np.where(np.isfinite(lower), 0.5 * (upper - lower), np.abs(upper))[:, None]
    hard = np.where(there, over / width, 0.0).max(axis=(1, 2, 3), initial=0.0)
    cost = np.einsum("bjvw,bjw->bjv", H, v) + h
    end = np.einsum("bij,bj->bi", H_end, x[-1]) + h_end
    pull = np.einsum("bjr,brv->bjv", force[:, 0] - force[:, 1], D)
    behind, dual = end, np.zeros(len(u))
    size = np.full(len(u), 1e-300)
    for j in reversed(range(N)):
        terms = cost[:, j, n:], pull[:, j, n:], np.einsum("bi,bip->bp", behind, B)
        dual = np.maximum(dual, np.abs(sum(terms)).max(axis=1))
        size = np.maximum(size, np.max([np.abs(term).max(axis=1) for term in terms], axis=0))
        behind = cost[:, j, :n] + pull[:, j, :n] + np.einsum("bi,bij->bj", behind, A)
    left = np.where(there, np.minimum(over, 0.0), 0.0)
    gap = np.abs(force * left).sum(axis=(1, 2, 3))
    costs = np.abs(cost * v).sum(axis=(1, 2)) + np.abs(end * x[-1]).sum(axis=1)
    negative = -np.minimum(force, 0.0).min(axis=(1, 2, 3)) / size
    return np.max([hard, dual / size, gap / costs, negative], axis=0)


def one_of(batch, k):
    """Member k of a batch."""
    return jax.tree.map(lambda leaf: np.asarray(leaf)[k], batch)
