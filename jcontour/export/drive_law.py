"""A linear controller as a drive computes it: matrices, and a plan with a row for every sample.

    x  <- x + L (y - C x)                  correction, where there is an observer
    u   = f_k - F_k x - D_k y,             kept to its limit
    x  <- A x + B u + E y + w_k            memory of the next sample
The plan holds what changes along the path: F, D, f and w. A matrix without an entry but zero is
None, and its term is left out.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class Correction:
    """Observer gain L [memory per measurement] and measured rows C of the memory."""

    L: Float[np.ndarray, "n q"]
    C: Float[np.ndarray, "q n"]


@dataclass(frozen=True)
class DriveLaw:
    """What does not change along the path.

    Attributes:
        dt: sample period [s].
        start: memory x before the first sample.
        names: of the entries of the memory.
        measured: entries q of the measurement.
        inputs: controls p.
        correction: of the memory by the measurement.
        A, B, E: of the next memory.
        limit: of every control, +-; infinite where there is none.
    """

    dt: float
    start: Float[np.ndarray, " n"]
    names: tuple[str, ...]
    measured: int
    inputs: int
    correction: Correction | None
    A: Float[np.ndarray, "n n"] | None
    B: Float[np.ndarray, "n p"] | None
    E: Float[np.ndarray, "n q"] | None
    limit: Float[np.ndarray, " p"]

    @property
    def states(self) -> int:
        """Entries of the memory."""
        return self.start.size


@dataclass(frozen=True)
class DrivePlan:
    """What changes along the path: a row for every sample, equal gains stored once.

    Attributes:
        used: which of the gain sets every sample has.
        F: gain sets of the memory.
        D: gain sets of the measurement.
        f: control that is fed forward.
        w: likewise, of the memory.
    """

    used: Int[np.ndarray, " T"]
    F: Float[np.ndarray, "sets p n"] | None
    D: Float[np.ndarray, "sets p q"] | None
    f: Float[np.ndarray, "T p"]
    w: Float[np.ndarray, "T n"] | None

    @property
    def steps(self) -> int:
        """Samples T."""
        return len(self.f)

    @property
    def numbers(self) -> int:
        """Numbers in the tables."""
        tables = (self.used, self.F, self.D, self.f, self.w)
        return sum(table.size for table in tables if table is not None)


def some(matrix: np.ndarray) -> np.ndarray | None:
    """The matrix; None where it has no entry but zero."""
    return matrix if np.any(matrix) else None


def drive_plan(
    F: Float[np.ndarray, "T p n"],
    D: Float[np.ndarray, "T p q"],
    f: Float[np.ndarray, "T p"],
    w: Float[np.ndarray, "T n"],
) -> DrivePlan:
    """Plan with equal gains stored once; no bit is lost.

    >>> same = np.ones((5, 1, 2))
    >>> plan = drive_plan(same, np.zeros((5, 1, 1)), np.zeros((5, 1)), np.zeros((5, 2)))
    >>> plan.F.shape, plan.D, plan.used.tolist()
    ((1, 1, 2), None, [0, 0, 0, 0, 0])
    """
    steps, n = len(f), F.shape[2]
    both = np.concatenate([F, D], axis=2)
    flat = np.ascontiguousarray(both.reshape(steps, -1) + 0.0)  # -0 and 0 are one set
    _, first, used = np.unique(flat, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # sets in the order of the path
    rank = np.empty_like(order)
    rank[order] = np.arange(order.size)
    sets = both[first[order]]
    used = rank[used.reshape(-1)]
    return DrivePlan(used, some(sets[:, :, :n]), some(sets[:, :, n:]), f, some(w))


def replayed(
    law: DriveLaw, plan: DrivePlan, measurement: Float[np.ndarray, "T q"]
) -> Float[np.ndarray, "T p"]:
    """Controls that the law gives for recorded measurements, by matrix products.

    The written code adds in another order: controls agree up to rounding.
    """
    x, controls = law.start.copy(), []
    for k, y in enumerate(measurement):
        if law.correction is not None:
            x = x + law.correction.L @ (y - law.correction.C @ x)
        u = plan.f[k].copy()
        for sets, signal in ((plan.F, x), (plan.D, y)):
            if sets is not None:
                u = u - sets[plan.used[k]] @ signal
        u = np.clip(u, -law.limit, law.limit)
        after = np.zeros_like(x) if plan.w is None else plan.w[k]
        for matrix, signal in ((law.A, x), (law.B, u), (law.E, y)):
            if matrix is not None:
                after = after + matrix @ signal
        x = after
        controls.append(u)
    return np.array(controls).reshape(len(measurement), law.inputs)
