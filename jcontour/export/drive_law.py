"""A linear controller as a drive computes it: what it does about a departure from a planned run.

    z   = y - r_k                           measurement, from that of the planned run
    e  <- e + L (z - C e)                   correction, where there is an observer
    u   = f_k - F_k e - D_k z,              kept to its limit
    e  <- A e + B (u - f_k) + E z           memory of the next sample; f_k is kept to the limit too
    e  <- clip(e + m_k) - clip(m_k)         of memory that the controller keeps within a limit
The memory e begins at zero: it is the controller's own memory less that of the planned run. All
sums are of small numbers, so they keep their digits in single precision. The plan holds what
changes along the path: F, D, f, r and m, the planned memory of the next sample before its limit. A
matrix without an entry but zero is None, and its term is left out.

Written code holds the last departure z of a measurement that is no number, and says so.
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
        names: of the entries of the memory.
        measured: entries q of the measurement.
        inputs: controls p.
        correction: of the memory by the measurement.
        A, B, E: of the next memory.
        limit: of every control, +-; infinite where there is none.
        kept: limit of every entry of the memory, +-, as against windup; infinite where there is
            none, None where there is none at all. It is of the controller's own memory.
        exact: whether that is all that the controller's own limits do to its memory.
    """

    dt: float
    names: tuple[str, ...]
    measured: int
    inputs: int
    correction: Correction | None
    A: Float[np.ndarray, "n n"] | None
    B: Float[np.ndarray, "n p"] | None
    E: Float[np.ndarray, "n q"] | None
    limit: Float[np.ndarray, " p"]
    kept: Float[np.ndarray, " n"] | None = None
    exact: bool = True

    @property
    def clamped(self) -> Int[np.ndarray, " c"]:
        """Entries of the memory that are kept within a limit."""
        kept = np.full(self.states, np.inf) if self.kept is None else self.kept
        return np.flatnonzero(np.isfinite(kept))

    @property
    def clamps(self) -> Float[np.ndarray, " c"]:
        """Their limits, +-."""
        return np.zeros(0) if self.kept is None else self.kept[self.clamped]

    @property
    def states(self) -> int:
        """Entries of the memory."""
        return len(self.names)


@dataclass(frozen=True)
class DrivePlan:
    """What changes along the path: a row for every sample, equal gains stored once.

    Attributes:
        used: which of the gain sets every sample has.
        F: gain sets of the memory.
        D: gain sets of the measurement.
        f: controls of the planned run, before any limit.
        r: measurements of the planned run.
        m: its memory after every sample, before any limit, of the entries that are kept within one;
            None where there are none.
    """

    used: Int[np.ndarray, " T"]
    F: Float[np.ndarray, "sets p n"] | None
    D: Float[np.ndarray, "sets p q"] | None
    f: Float[np.ndarray, "T p"]
    r: Float[np.ndarray, "T q"]
    m: Float[np.ndarray, "T c"] | None = None

    @property
    def steps(self) -> int:
        """Samples T."""
        return len(self.f)

    @property
    def numbers(self) -> int:
        """Numbers in the tables."""
        tables = (self.used, self.F, self.D, self.f, self.r, self.m)
        return sum(table.size for table in tables if table is not None)


def some(matrix: np.ndarray) -> np.ndarray | None:
    """The matrix; None where it has no entry but zero."""
    return matrix if np.any(matrix) else None


def drive_plan(
    F: Float[np.ndarray, "T p n"],
    D: Float[np.ndarray, "T p q"],
    f: Float[np.ndarray, "T p"],
    r: Float[np.ndarray, "T q"],
    m: Float[np.ndarray, "T c"] | None = None,
) -> DrivePlan:
    """Plan with equal gains stored once; no bit is lost.

    >>> same = np.ones((5, 1, 2))
    >>> plan = drive_plan(same, np.zeros((5, 1, 1)), np.zeros((5, 1)), np.zeros((5, 1)))
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
    return DrivePlan(used, some(sets[:, :, :n]), some(sets[:, :, n:]), f, r, m)


def replayed(
    law: DriveLaw,
    plan: DrivePlan,
    measurement: Float[np.ndarray, "T q"],
    kind: type[np.floating] = np.float64,
) -> Float[np.ndarray, "T p"]:
    """Controls that the law gives for recorded measurements, by matrix products.

    The written code adds in another order: controls agree up to rounding.

    Args:
        law: what does not change along the path.
        plan: what does.
        measurement: a row for every sample.
        kind: of every number, np.float32 for single precision.
    """
    A, B, E, F, D = (_rounded(one, kind) for one in (law.A, law.B, law.E, plan.F, plan.D))
    limit, f, r = law.limit.astype(kind), plan.f.astype(kind), plan.r.astype(kind)
    clamps, m = law.clamps.astype(kind), _rounded(plan.m, kind)
    L = _rounded(law.correction and law.correction.L, kind)
    C = _rounded(law.correction and law.correction.C, kind)
    e, controls = np.zeros(law.states, kind), []
    for k, z in enumerate(measurement.astype(kind) - r):
        if L is not None and C is not None:
            e = e + L @ (z - C @ e)
        u = f[k].copy()
        for sets, signal in ((F, e), (D, z)):
            if sets is not None:
                u = u - sets[plan.used[k]] @ signal
        u = np.clip(u, -limit, limit)
        change, after = u - np.clip(f[k], -limit, limit), np.zeros_like(e)
        for matrix, signal in ((A, e), (B, change), (E, z)):
            if matrix is not None:
                after = after + matrix @ signal
        if m is not None:
            kept = np.clip(after[law.clamped], -clamps - m[k], clamps - m[k])
            after[law.clamped] = kept + (m[k] - np.clip(m[k], -clamps, clamps))
        e = after
        controls.append(u)
    return np.array(controls, kind).reshape(len(measurement), law.inputs)


def _rounded(matrix: np.ndarray | None, kind: type[np.floating]) -> np.ndarray | None:
    return None if matrix is None else matrix.astype(kind)
