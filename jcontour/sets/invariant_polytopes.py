"""Robust invariant sets as polytopes: under a gain, and under the best control (Algorithm 1).

    x(k+1) = A x(k) + B u(k) + E w(k),   |w_i| <= 1
A set is robust control invariant if from every point some allowed control keeps the state in it,
whatever the disturbance does. Tractable for few states: the number of rows grows with every step.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.sets.disturbed_model import DisturbedModel, Numbers
from jcontour.sets.polytopes import Polytope, polytope

MOST_ROWS = 5000  # reduction takes a linear program per row: minutes from here on


class InvariantSet(NamedTuple):
    """An invariant set and how it was found.

    Attributes:
        polytope: the set.
        steps: after which the iteration stopped.
    """

    polytope: Polytope
    steps: int


def invariant_under_gain(
    M: Numbers, E: Numbers, allowed: Polytope, most_steps: int = 1000
) -> InvariantSet | None:
    """The largest set inside `allowed` that x+ = M x + E w does not leave; None where it is empty.

    Rows H M^k x <= h - sum_{j<k} |H M^j E|_1 are added until those of one more step say nothing
    (Gilbert & Tan 1991, Kolmanovsky & Gilbert 1998).

    Raises:
        ValueError: it has not ended after `most_steps`.
    """
    loop, size = np.asarray(M, float), np.asarray(E, float)
    disturbance = size[:, None] if size.ndim == 1 else size
    rows, bounds = allowed.H, allowed.h
    found = allowed
    for step in range(1, most_steps + 1):
        bounds = bounds - np.abs(rows @ disturbance).sum(axis=1)
        rows = rows @ loop
        if found.empty:
            return None
        new = _saying_something(found, rows, bounds)
        if new is None:
            return InvariantSet(found.reduced(), step)
        found = found.intersection(new)
    raise ValueError(f"most_steps: no end after {most_steps} steps")


def control_invariant(
    model: DisturbedModel,
    allowed: Polytope,
    controls: Float[np.ndarray, " p"],
    margin: float,
    most_steps: int = 100,
) -> InvariantSet | None:
    """A control invariant set inside `allowed` (Yuan, Algorithm 1); None where it ends empty.

        R_{i+1} = R_i intersected with {x : there is u with A x + B u + E w in R_i - B(margin)}
    ends as soon as R_i - B(margin) lies in R_{i+1}; B(margin) is the ball of the Euclidean norm in
    these coordinates. Theorem 4.1's test, with R_i - B inside R_{i+1} (see errata), makes the
    result invariant and the end come in finitely many steps. An empty end with a margin above zero
    proves nothing about the machine: a certificate does, see `tolerance_certificates`.

    Args:
        model: A, B, E.
        allowed: polytope of states.
        controls: largest magnitudes of the controls (p,).
        margin: rho of the ball, above zero.
        most_steps: of the iteration.

    Raises:
        ValueError: bad input, no end within `most_steps`, or more rows than are tractable.
    """
    limits = np.broadcast_to(np.asarray(controls, float), (model.inputs,))
    if not margin > 0:
        raise ValueError(f"margin: needs to be above zero, received {margin}")
    found = allowed.reduced()
    for step in range(1, most_steps + 1):
        if found.empty:
            return None
        inner = Polytope(found.H, found.h - margin)
        if inner.empty:
            return None
        before = _predecessors(model, inner, limits)
        following = found.intersection(before)
        if len(following.h) > MOST_ROWS:
            raise ValueError(f"allowed: more than {MOST_ROWS} rows after {step} steps")
        following = following.reduced()
        if following.empty:
            return None
        if inner.within(following, 0.0):
            return InvariantSet(following, step)
        found = following
    raise ValueError(f"most_steps: no end after {most_steps} steps, {len(found.h)} rows")


def _predecessors(model: DisturbedModel, target: Polytope, limits: np.ndarray) -> Polytope:
    """States that some allowed control brings into the target, whatever the disturbance."""
    eroded = target.eroded(model.E)
    n, p = model.states, model.inputs
    on_controls = np.concatenate([np.zeros((2 * p, n)), np.kron([[1], [-1]], np.eye(p))], axis=1)
    rows = np.concatenate([eroded.H @ model.A, eroded.H @ model.B], axis=1)
    both = polytope(np.concatenate([rows, on_controls]), np.concatenate([eroded.h, limits, limits]))
    for _ in range(p):
        both = both.without_last()
        if len(both.h) > MOST_ROWS:
            raise ValueError(f"allowed: more than {MOST_ROWS} rows in a projection")
    return both


def _saying_something(found: Polytope, rows: np.ndarray, bounds: np.ndarray) -> Polytope | None:
    """Those rows that cut the set; None without any."""
    cut = found.support(rows) > bounds + 1e-10 * np.maximum(1.0, np.abs(bounds))
    return Polytope(rows[cut], bounds[cut]) if cut.any() else None
