"""What searches have found so far, kept in a file so that a benchmark can go on."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from jcontour.app.files.results.stored import from_json, to_json
from jcontour.app.files.run_folder import read_json, write_json

BETTER = 0.99  # of the best value known: a search that ended there has ended too early


@dataclass(frozen=True)
class Trace:
    """Every better feasible value that one search found.

    >>> one = Trace([3.0, 9.0], [5.0, 2.0], [0.1, 0.2], 12.0)
    >>> one.at(np.array([1, 3, 8, 9, 99])).tolist()
    [inf, 5.0, 5.0, 2.0, 2.0]
    >>> one.until(2.5), one.until(1.0)
    ((9.0, 0.2), (inf, inf))

    Attributes:
        spent: evaluations until then.
        best: the value.
        seconds: of processor time until then.
        total: evaluations of the whole search.
        enough: value at which it ended at once.
    """

    spent: list[float]
    best: list[float]
    seconds: list[float]
    total: float
    enough: float = 0.0

    @classmethod
    def of(
        cls,
        values: Sequence[float],
        spent: Sequence[float],
        seconds: Sequence[float],
        enough: float = 0.0,
    ) -> "Trace":
        """From every value; infinite for a point beyond a limit."""
        if not len(values):
            return cls([], [], [], 0.0, enough)
        best = np.minimum.accumulate(np.asarray(values, float))
        better = best < np.append(np.inf, best[:-1])
        kept = [np.asarray(one, float)[better].tolist() for one in (spent, best, seconds)]
        return cls(*kept, float(spent[-1]), enough)

    @property
    def least(self) -> float:
        """The best value; infinite where there is none."""
        return self.best[-1] if self.best else np.inf

    def too_early(self, known: float) -> bool:
        """Whether it ended at a value that was good then, and is not beside the best known now.

        >>> Trace([1.0], [5.0], [0.1], 1.0, enough=5.1).too_early(4.0)
        True
        """
        return self.least <= self.enough and known < BETTER * self.least

    def at(self, counts: np.ndarray) -> np.ndarray:
        """Best value within so many evaluations; infinite before the first."""
        index = np.searchsorted(self.spent, counts, side="right")
        return np.append(np.inf, self.best)[index]

    def until(self, value: float) -> tuple[float, float]:
        """Evaluations and seconds to come to a value; infinite where it does not."""
        for spent, best, seconds in zip(self.spent, self.best, self.seconds, strict=True):
            if best <= value:
                return spent, seconds
        return np.inf, np.inf


@dataclass
class ProblemTraces:
    """Traces of one problem.

    Attributes:
        weights: number of them.
        known: best value known; a search that comes there stops.
        compiling: seconds of processor time to compile a value, and a value with slopes.
        evaluating: seconds of processor time of one of each, afterwards.
        traces: of every method, one for each seed.
    """

    weights: int
    known: float
    compiling: tuple[float, float]
    evaluating: tuple[float, float]
    traces: dict[str, list[Trace]] = field(default_factory=dict)

    def __post_init__(self):
        """JSON has no infinity: a file says null, which is read as NaN."""
        if np.isnan(self.known):
            self.known = np.inf

    def lacks(self, method: str, seed: int) -> bool:
        """Whether a search has not begun at a seed yet, or ended too early."""
        several = self.traces.get(method, [])
        return seed >= len(several) or several[seed].too_early(self.known)

    def put(self, method: str, seed: int, trace: Trace) -> None:
        """One more trace, or another in its place.

        Raises:
            ValueError: the search has not begun at all seeds before.
        """
        several = self.traces.setdefault(method, [])
        if seed > len(several):
            raise ValueError(f"seed: {method} has {len(several)} of them, received {seed}")
        several[seed : seed + 1] = [trace]
        self.known = min(self.known, trace.least)


@dataclass
class Record:
    """Traces of all problems, and the number of evaluations that a search may use."""

    budget: int
    problems: dict[str, ProblemTraces] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path | None, budget: int) -> "Record":
        """What a file holds; nothing where there is none.

        Raises:
            ValueError: the file has another budget, or is none of these.
        """
        if path is None or not path.exists():
            return cls(budget)
        found = from_json(read_json(path.parent, path.name), cls)
        if found.budget != budget:
            raise ValueError(f"evaluations: {path} has {found.budget} of them, received {budget}")
        return found

    def write(self, path: Path | None) -> None:
        """Keep it in a file, where one is given."""
        if path is not None:
            write_json(path, to_json(self))
