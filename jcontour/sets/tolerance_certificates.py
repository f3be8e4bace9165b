"""Proof that no controller keeps a tolerance: a linear program, and multipliers that check it.

    x(k+1) = A x(k) + B u(k) + E w(k),   |w_i| <= 1
A controller chooses u(k) before it knows w(k). If it keeps |c x| <= limit for every w, then

    |c (x(k+1) - E w(k))| <= limit - |c E|_1
at every sample, for the w that does act. Along a known reference and under one chosen sequence w
these are linear rows of (x, u, tolerance). Their least tolerance is a lower bound for every
controller, linear or not, with or without preview, and for every start.

The bound is not taken from the solver. With any multipliers y of the equations and z >= 0 of the
rows, the least of the Lagrangian over the box of the variables is a bound: it is added up here.
"""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float
from scipy.optimize import linprog

from jcontour.sets.responses import DisturbedModel, Numbers, Signal

GAP = 1e-6  # relative, between the solver's optimum and what its multipliers prove


def least_tolerance_of_any(
    model: DisturbedModel,
    wanted: Signal,
    limited: Sequence[Signal],
    reference: Numbers,
    disturbance: Numbers,
    offsets: Numbers | None = None,
) -> float:
    """Lower bound on the largest |wanted - reference| of any controller, proven by multipliers.

    Args:
        model: A, B, E.
        wanted: the signal that follows the reference; its limit is the largest tolerance asked
            about.
        limited: signals with finite limits, among them every control alone: they bound the proof.
        reference: values r_0..r_T (T+1,) that `wanted` should have.
        disturbance: w_0..w_{T-1} (T, q), each entry at most one.
        offsets: middle of the limits of every signal in `limited`, zero when not given.

    Raises:
        ValueError: shapes do not fit, a limit is infinite, a disturbance is outside its box, limits
            leave nothing at all, or the multipliers prove less than the solver claims.
    """
    target, acting = np.asarray(reference, float), np.asarray(disturbance, float)
    _check(model, wanted, limited, target, acting)
    middles = np.zeros(len(limited)) if offsets is None else np.asarray(offsets, float)
    T, n, p = len(acting), model.states, model.inputs
    equations = sparse.csr_array(
        sparse.hstack(
            [
                sparse.kron(sparse.eye_array(T, T + 1, k=1), np.eye(n))
                - sparse.kron(sparse.eye_array(T, T + 1), model.A),
                -sparse.kron(sparse.eye_array(T), model.B),
                sparse.csr_array((T * n, 1)),
            ]
        )
    )
    values = (acting @ model.E.T).ravel()
    moving = [one for one in zip(limited, middles, strict=True) if one[0].state.any()]
    kept = [_kept(model, acting, signal, middle, signal.limit, 0.0) for signal, middle in moving]
    kept.append(_kept(model, acting, wanted, target, 0.0, 1.0))
    rows = sparse.csr_array(sparse.vstack([one for one, _ in kept]))
    bounds = np.concatenate([one for _, one in kept])
    # bounds of x_0..x_T and u_0..u_{T-1} that signals of one coordinate give
    least = np.full(n + p, -np.inf)
    most = -least
    for signal, middle in zip(limited, middles, strict=True):
        row = np.concatenate([signal.state, signal.control])
        (places,) = np.nonzero(row)
        if places.size == 1:
            (place,) = places
            ends = np.sort((middle + np.array([-1, 1]) * signal.limit) / row[place])
            least[place], most[place] = max(least[place], ends[0]), min(most[place], ends[1])
    if np.isinf(np.concatenate([least, most])).any():
        raise ValueError("limited: the proof needs a limit on every state and on every control")
    low, high = (
        np.concatenate([np.tile(end[:n], T + 1), np.tile(end[n:], T), [tolerance]])
        for end, tolerance in ((least, 0.0), (most, wanted.limit))
    )
    cost = np.zeros((T + 1) * n + T * p + 1)
    cost[-1] = 1.0
    program = linprog(
        cost, rows, bounds, equations, values, bounds=np.stack([low, high], axis=1), method="highs"
    )
    if program.status != 0:
        raise ValueError(
            f"limits: nothing keeps them within a tolerance of {wanted.limit:.6g}, "
            "whatever the controller"
        )
    y, z = program.eqlin.marginals, np.minimum(program.ineqlin.marginals, 0.0)
    rest = cost - equations.T @ y - rows.T @ z
    proven = float(y @ values + z @ bounds + np.minimum(rest * low, rest * high).sum())
    if proven < program.fun - GAP * max(abs(program.fun), np.finfo(float).tiny):
        raise ValueError(
            f"certificate: the multipliers prove {proven:.6g}, the solver claims {program.fun:.6g}"
        )
    return proven


def _kept(
    model: DisturbedModel,
    acting: Float[np.ndarray, "T q"],
    signal: Signal,
    middle: float | Float[np.ndarray, " t"],
    limit: float,
    share: float,
) -> tuple[sparse.csr_array, Float[np.ndarray, " rows"]]:
    """Rows over x_0..x_T, u_0..u_{T-1} and the tolerance, and their bounds."""
    # |c x + d u - middle| <= limit + share * tolerance at every sample; before the disturbance acts
    # the largest state takes its share of the limit but at the first sample
    T, effect = len(acting), signal.state @ model.E
    loss = np.full(T + 1, np.abs(effect).sum())
    loss[0] = 0.0
    acted = np.concatenate([[0.0], acting @ effect])
    states = sparse.kron(sparse.eye_array(T + 1), signal.state)
    controls = sparse.kron(sparse.eye_array(T + 1, T), signal.control)
    both, last = sparse.hstack([states, controls]), np.full((T + 1, 1), -share)
    rows = [sparse.hstack([sign * both, sparse.csr_array(last)]) for sign in (1.0, -1.0)]
    bounds = [limit - loss + sign * (middle + acted) for sign in (1.0, -1.0)]
    return sparse.csr_array(sparse.vstack(rows)), np.concatenate(bounds)


def _check(model, wanted, limited, target, acting) -> None:
    if acting.ndim != 2 or acting.shape[1] != model.disturbances or len(acting) == 0:
        raise ValueError(
            f"disturbance: needs shape (T, {model.disturbances}), received {acting.shape}"
        )
    if target.shape != (len(acting) + 1,):
        raise ValueError(
            f"reference: needs one value more than the disturbance, {len(acting) + 1}, "
            f"received {target.shape}"
        )
    if np.abs(acting).max() > 1:
        raise ValueError("disturbance: needs entries of at most one, the size is in E")
    if not all(np.isfinite(signal.limit) for signal in [wanted, *limited]):
        raise ValueError("limits: the proof needs finite ones")
