"""Robust control invariant sets as polytopes (Yuan, Algorithm 1).

    x(k+1) = A x(k) + B u(k) + E w(k),   |w_i| <= 1
A set is robust control invariant if from every point some allowed control keeps the state in it,
whatever the disturbance does. Tractable for few states: the number of rows grows with every step.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jcontour.sets.disturbed_model import DisturbedModel
from jcontour.sets.polytopes import Polytope

MOST_ROWS = 5000  # corners of more take minutes


class InvariantSet(NamedTuple):
    """An invariant set and how it was found.

    Attributes:
        polytope: the set.
        steps: after which the iteration stopped.
    """

    polytope: Polytope
    steps: int


def control_invariant(
    model: DisturbedModel,
    allowed: Polytope,
    controls: Float[np.ndarray, " p"],
    margin: float,
    most_steps: int = 100,
) -> InvariantSet | None:
    """A control invariant set inside `allowed`; None where the iteration ends empty.

        R_{i+1} = R_i intersected with {x : there is u with A x + B u + E w in R_i - B(margin)}
    ends as soon as R_i - B(margin) lies in R_{i+1}; B(margin) is the ball of the Euclidean norm in
    these coordinates. Theorem 4.1's test, with R_i - B inside R_{i+1} (see errata), makes the
    result invariant and the end come in finitely many steps. An empty end with a margin above zero
    proves nothing about the machine: a certificate does, see `tolerance_certificates`.

    Args:
        model: A, B, E, of two states or more.
        allowed: polytope of states, rows of unit length.
        controls: largest magnitudes of the controls (p,).
        margin: rho of the ball, above zero.
        most_steps: of the iteration.

    Raises:
        ValueError: bad input, no end within `most_steps`, or more rows than are tractable.
    """
    limits, p = np.broadcast_to(np.asarray(controls, float), (model.inputs,)), model.inputs
    if not margin > 0:
        raise ValueError(f"margin: needs to be above zero, received {margin}")
    on_controls = np.concatenate(
        [np.zeros((2 * p, model.states)), np.kron([[1], [-1]], np.eye(p))], axis=1
    )
    found = allowed.reduced()
    for step in range(1, most_steps + 1):
        inner = Polytope(found.H, found.h - margin)
        # states and controls from which the next state is in the inner set under every disturbance
        eroded = inner.h - np.abs(inner.H @ model.E).sum(axis=1)
        rows = np.concatenate([inner.H @ model.A, inner.H @ model.B], axis=1)
        both = Polytope(
            np.concatenate([rows, on_controls]), np.concatenate([eroded, limits, limits])
        )
        if inner.middle is None or both.middle is None:
            return None
        following = found.intersection(both.shadow(model.states))
        if following.middle is None:
            return None
        following = following.reduced()
        if len(following.h) > MOST_ROWS:
            raise ValueError(f"allowed: more than {MOST_ROWS} rows after {step} steps")
        if inner.within(following):
            return InvariantSet(following, step)
        found = following
    raise ValueError(f"most_steps: no end after {most_steps} steps, {len(found.h)} rows")
