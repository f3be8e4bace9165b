"""Yuan, section 2.3: contouring schemes for biaxial machines, tuned alike, on unseen contours.

The section is a survey without numbers of its own. Here all its schemes stand around the same
cascade on a machine of two different flexible axes. First the cascade is tuned. Then every scheme,
the plain cascade among them, descends twice: once from there and once from the thesis's gains. All
descents have the same contours, limits and number of evaluations, on the smooth twin. That is done
with feedback alone, as in the papers of the survey, and with what the motion needs fed forward. The
tables are of the machine with stick and slip. Its end effectors are not measured.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import jax
import numpy as np

from experiments.papers.contouring_schemes.runs import (
    CASCADE,
    FEEDBACK,
    LOOPS,
    MODEL_ERRORS,
    STRONG,
    TUNED_ON,
    Row,
    Scheme,
    Setup,
    rows,
    schemes,
)
from tuning.tuner import Evaluated, Tuned

SOURCE = (
    "M. Yuan: A Model-based Approach for High Performance Motion Control in Industrial Machines. "
    "Doctoral thesis, The University of Melbourne (2020), section 2.3, "
    "after Y. Koren (1980), Y. Koren & C.-C. Lo (1991), "
    "J.-H. Chin & T.-C. Lin (1997), C.-C. Lo & C. Y. Chung (1999), "
    "G. T.-C. Chiu & M. Tomizuka (2001), C. S. Chen & L. Y. Chen (2011)"
)
QUICK_PART = 5  # a quick run has this part of the evaluations
LEAST = 3  # evaluations of a descent


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce contouring-schemes`."""

    quick: bool = False
    """A fifth of the evaluations, feedback alone, no errors in masses; it decides no statement."""
    evaluations: int = 50
    """Of objective and gradient in one descent: one for the cascade, then two for every scheme."""

    def __post_init__(self):
        if self.evaluations < LEAST:
            raise ValueError(f"evaluations: needs at least three, received {self.evaluations}")


@dataclass(frozen=True)
class TunedScheme:
    """Gains of one scheme, and how its tuning went."""

    scheme: str
    loops: str
    cascade: dict[str, list[float]]
    gains: list[float]  # of the scheme itself
    feasible: bool
    diverged_points: int
    smooth_um: float  # mean RMS contour error on the smooth twin
    best_um: Sequence[float]  # best feasible objective after every evaluation, the cascade's first


@dataclass(frozen=True)
class Result:
    """How all schemes were tuned, and their runs on the true machines."""

    quick: bool  # too few evaluations for a verdict
    evaluations: int  # of one descent
    limits: dict[str, float]
    tuning: tuple[TunedScheme, ...]
    rows: tuple[Row, ...]

    def different(self, column: str) -> list[str]:
        """Values of a column of the runs, each once: "scheme", "loops", "plant", "contour"."""
        return list(dict.fromkeys(getattr(row, column) for row in self.rows))

    @property
    def schemes(self) -> list[str]:
        """Tuned schemes: all but the cascade before it is tuned."""
        return list(dict.fromkeys(row.scheme for row in self.tuning))

    def mean(
        self, scheme: str, loops: str, plant: str, column: str = "contour_um", **which: object
    ) -> float:
        """Mean of a column over runs, which are those of some `training` or `contour`.

        Infinite when a run diverged or has no such number.
        """
        wanted = {"scheme": scheme, "loops": loops, "plant": plant, **which}
        rows = [
            row
            for row in self.rows
            if all(getattr(row, name) == value for name, value in wanted.items())
        ]
        values = np.array([getattr(row, column) for row in rows])
        if any(row.diverged for row in rows) or not np.isfinite(values).all():
            return float("inf")
        return float(np.mean(values))


def run(settings: Settings) -> Result:
    """Tune and simulate everything."""
    plants, loops, budget = tuple(MODEL_ERRORS), tuple(LOOPS), settings.evaluations
    if settings.quick:
        plants, loops, budget = TUNED_ON, (FEEDBACK,), max(LEAST, budget // QUICK_PART)
    setup = Setup(TUNED_ON, budget)
    parts = [compared(setup, one, plants) for one in loops]
    bounds = np.asarray(setup.limits.bounds).tolist()
    return Result(
        quick=settings.quick,
        evaluations=budget,
        limits=dict(zip(setup.limits.names, bounds, strict=True)),
        tuning=tuple(row for tuning, _ in parts for row in tuning),
        rows=tuple(row for _, found in parts for row in found),
    )


def compared(
    setup: Setup, loops: str, plants: Sequence[str]
) -> tuple[list[TunedScheme], list[Row]]:
    """Tuning of every scheme around these loops, and its numbers on the true machines."""
    known, start = schemes(), LOOPS[loops].start
    cascade = known[CASCADE]
    first = setup.tuned(cascade, LOOPS[loops], [cascade.around(start)])

    def found(item: tuple[str, Scheme]) -> tuple[TunedScheme, list[Row]]:
        return scheme_tuned(setup, loops, *item, first, plants)

    with ThreadPoolExecutor(2) as pool:  # one compiles while the other descends
        parts = list(pool.map(found, known.items()))
    untuned = rows("start", loops, cascade.build(cascade.around(start)), plants)
    return [tuning for tuning, _ in parts], untuned + [row for _, made in parts for row in made]


def scheme_tuned(
    setup: Setup, loops: str, name: str, scheme: Scheme, first: Tuned, plants: Sequence[str]
) -> tuple[TunedScheme, list[Row]]:
    """Tuning of one scheme, from the tuned cascade and from the thesis's gains, and its rows."""
    near = scheme.around(first.weights.cascade)
    far = scheme.around(LOOPS[loops].start, STRONG)
    tuned = setup.tuned(scheme, LOOPS[loops], [near, far])
    numbers = rows(name, loops, scheme.build(tuned.weights), plants)
    weights = (vars(tuned.weights.cascade), tuned.weights.scheme)
    cascade, gains = jax.tree.map(lambda leaf: np.asarray(leaf).tolist(), weights)
    values = [_feasible_um(row) for row in (*first.history, *tuned.history)]
    described = TunedScheme(
        scheme=name,
        loops=loops,
        cascade=cascade,
        gains=list(gains),
        feasible=tuned.feasible,
        diverged_points=tuned.diverged_points,
        smooth_um=1e6 * float(np.mean(tuned.outcome.metrics.rms_contour_error)),
        best_um=np.minimum.accumulate(values).tolist(),
    )
    return described, numbers


def _feasible_um(row: Evaluated) -> float:
    """Objective [um]; infinite where the point exceeds a limit or diverges."""
    return 1e6 * row.objective if row.violation <= 0 and not row.diverged else np.inf
