"""The parts of a record in which an axis keeps moving one way.

There dry friction is one number, whatever it is near a standstill: while the axis turns or sticks
nothing is asked of the model. What a reversal leaves behind is the state in which the next piece
begins. So every piece has a free start of its own:

    free response of 1 / A, and as many powers of the time as there are integrators less one

and what is left of a signal when these are taken out is all that is fitted.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg.lapack import dgeqrf, dorgqr  # pyright: ignore[reportAttributeAccessIssue]
from scipy.signal import lfilter

from tuning.identification.linear.noise_model import WHITE, whitened

SHORT, LONG = 6, 40  # terms of a noise filter: for counts alone, and for what acts on the way
LEAST = 4  # samples of a piece for each term: its first ones only fill the filter


@dataclass(frozen=True)
class Pieces:
    """Parts of a record.

    Attributes:
        ends: first sample of each, and the one behind its last.
        terms: of the noise filter, for which all are long enough.
    """

    ends: tuple[tuple[int, int], ...] = ()
    terms: int = SHORT

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return iter(self.ends)

    def __bool__(self) -> bool:
        return bool(self.ends)

    @property
    def none(self) -> Float[np.ndarray, " w"]:
        """No noise filter, as long as any: then all fits are judged by the same samples."""
        return np.eye(1, self.terms + 1)[0]

    @property
    def longest(self) -> int:
        """Samples of the longest."""
        return max(end - start for start, end in self)

    def within(self, start: int, end: int) -> "Pieces":
        """Pieces of a part of the record, counted from its start."""
        cut = ((max(a, start) - start, min(b, end) - start) for a, b in self)
        return self.of(cut, self.terms)

    @classmethod
    def of(cls, ends: Iterable[tuple[int, int]], terms: int) -> "Pieces":
        """Those that are long enough."""
        return cls(tuple(one for one in ends if one[1] - one[0] >= LEAST * terms), terms)


def rows_of(pieces: Pieces, skip: int) -> Int[np.ndarray, " R"]:
    """Samples of all pieces, without the first few of each."""
    return np.concatenate([np.arange(start + skip, end) for start, end in pieces])


def free_start(
    below: Float[np.ndarray, " a"],
    integrators: int,
    filter_: Float[np.ndarray, " w"],
    pieces: Pieces,
) -> Float[np.ndarray, "L f"]:
    """Columns of a free start, behind the noise filter, as long as the longest piece."""
    longest = pieces.longest
    pulse = lfilter([1.0], below, np.eye(1, longest)[0])
    time = np.linspace(-1, 1, longest)
    columns = [np.pad(pulse, (j, 0))[:longest] for j in range(len(below) - 1)]
    columns += [time**j for j in range(integrators)]
    if not columns:
        return np.zeros((longest, 0))
    return np.stack([whitened(one, filter_) for one in columns], axis=1)


def of_starts(
    signal: Float[np.ndarray, " T"],
    below: Float[np.ndarray, " a"],
    integrators: int,
    pieces: Pieces,
) -> Float[np.ndarray, " T"]:
    """What the free starts explain of a signal; nothing between the pieces."""
    free, rows = free_start(below, integrators, WHITE, pieces), rows_of(pieces, 0)
    explained = np.zeros(len(signal))
    explained[rows] = signal[rows] - started_apart(signal[:, None], free, pieces, 0)[:, 0]
    return explained


def started_apart(
    columns: Float[np.ndarray, "T c"], free: Float[np.ndarray, "L f"], pieces: Pieces, skip: int
) -> Float[np.ndarray, "R c"]:
    """Columns in all pieces, without what a free start of each explains."""
    left = []
    for start, end in pieces:
        part = columns[start + skip : end]
        base = _spanning(free[skip : end - start])
        left.append(part - base @ (base.T @ part))
    return np.concatenate(left)


def _spanning(columns: Float[np.ndarray, "R f"]) -> Float[np.ndarray, "R f"]:
    """Q of columns = Q R, straight from LAPACK: there are thousands of small ones."""
    factored, tau, _, _ = dgeqrf(columns)
    return dorgqr(factored, tau)[0]


def short_whitening(residual: Float[np.ndarray, " T"], pieces: Pieces) -> Float[np.ndarray, " w"]:
    """Filter 1, w_1, ..., w_n that makes what is left in the pieces white."""
    rows = rows_of(pieces, pieces.terms)
    past = np.stack([residual[rows - i] for i in range(1, pieces.terms + 1)], axis=1)
    found, *_ = np.linalg.lstsq(past, residual[rows], rcond=1e-10)
    return np.concatenate([[1.0], -found])
