"""Where an axis goes in the end under a constant control, from the model itself.

With the modes at 1 apart from all others, the transfer from the control to the position is

    H(z) = sum over j of c N^j b / (z - 1)^(j + 1) + R(z)

N is what the modes at 1 have beside the 1, and R(1) is finite. Under a control of one unit the
first term that is there decides:

    c N b / dt^2     acceleration that lasts: two integrators
    c b / dt         speed that lasts: one integrator
    R(1)             position: none
"""

from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.linalg import matrix_balance, schur, solve_sylvester

from jcontour.linear.plant import LinearPlant

Kind = Literal["position", "speed", "acceleration", "nothing"]
AT_ONE = 1e-6  # modes nearer to 1 are integrators: two of them are computed 1e-8 off
THERE = 1e-6  # of the way: a term that adds less is rounding


class Steady(NamedTuple):
    """What lasts under one unit of control.

    Attributes:
        kind: "nothing" where a mode grows without end.
        gain: its value [m, m/s, m/s^2 per control unit]; NaN of nothing.
        slowest: time constant of the slowest mode that dies out [samples]; 0 without one.
    """

    kind: Kind
    gain: float
    slowest: float


def steady_response(model: LinearPlant, axis: int) -> Steady:
    """What lasts of an axis's own position under a constant control of its own."""
    A, b, c = _own_part(model, axis)
    poles = np.linalg.eigvals(A)
    near = np.abs(poles - 1) < AT_ONE
    slowest = _slowest(np.abs(poles[~near]))
    if np.any(np.abs(poles[~near]) > 1 + AT_ONE) or near.sum() > 2:
        return Steady("nothing", float("nan"), slowest)
    position, speed, acceleration = _terms(A, b, c)
    horizon = 10 * max(slowest, len(A))  # samples, by when the position is in steady motion
    ways = np.abs([position, horizon * speed, horizon**2 * acceleration])
    dt = model.dt
    if ways[2] > THERE * ways.max():
        return Steady("acceleration", acceleration / dt**2, slowest)
    if ways[1] > THERE * ways.max():
        return Steady("speed", speed / dt, slowest)
    return Steady("position", position, slowest)


def _own_part(model: LinearPlant, axis: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, b, c of the states that the axis's control reaches and its position shows."""
    A, b, c = np.asarray(model.A), np.asarray(model.B)[:, axis], np.asarray(model.C)[axis]
    linked = A != 0
    own = _reached(linked, b != 0) & _reached(linked.T, c != 0)
    return A[np.ix_(own, own)], b[own], c[own]


def _reached(linked: np.ndarray, first: np.ndarray) -> np.ndarray:
    """States that others reach; `linked[i, j]` where state j acts on state i."""
    found = first
    for _ in first:
        found = found | linked @ found
    return found


def _slowest(sizes: np.ndarray) -> float:
    """Time constant of the slowest mode of these magnitudes that dies out [samples]."""
    dying = sizes[(sizes > 1e-6) & (sizes < 1 - AT_ONE)]
    return float(-1 / np.log(dying.max())) if dying.size else 0.0


def _terms(A: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[float, float, float]:
    """R(1), c b and c N b of the module's text."""
    A, scale = matrix_balance(A)
    b, c = np.linalg.solve(scale, b), c @ scale
    found: Any = schur(A.astype(complex), "complex", sort=lambda pole: abs(pole - 1) < AT_ONE)
    T, Q, m = found
    b, c = Q.conj().T @ b, c @ Q
    X = solve_sylvester(T[:m, :m], -T[m:, m:], -T[:m, m:]) if 0 < m < len(A) else T[:m, m:]
    at_one, rest = b[:m] - X @ b[m:], c[:m] @ X + c[m:]
    N = T[:m, :m] - np.eye(m)
    position = rest @ np.linalg.solve(np.eye(len(A) - m) - T[m:, m:], b[m:])
    return float(position.real), float((c[:m] @ at_one).real), float((c[:m] @ N @ at_one).real)
