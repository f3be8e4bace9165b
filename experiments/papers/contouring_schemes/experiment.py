"""Yuan, section 2.3: the contouring schemes for biaxial machines, tuned alike and compared on contours that none was tuned on.

The section is a survey without numbers of its own. Here all its schemes stand around the same
cascade on a machine of two different
flexible axes: first the cascade is tuned; then every scheme, the plain cascade among them, descends
once from there and once from the thesis's gains, with the same contours, limits and number of
evaluations on the smooth twin. That is done with feedback alone, as in the papers of the survey,
and with what the motion needs fed forward. The tables are of the machine with stick and slip; its
end effectors
are not measured.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from experiments.papers.contouring_schemes.claims import claims
from experiments.papers.contouring_schemes.figures import draw
from experiments.papers.contouring_schemes.machine import MODEL_ERRORS, TUNED_ON
from experiments.papers.contouring_schemes.runs import (
    CASCADE,
    FEEDBACK,
    LOOPS,
    SCHEMES,
    STRONG,
    Bench,
    rows,
)
from experiments.papers.contouring_schemes.tables import show
from tuning.tune import Evaluated, Tuned

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = (
    "M. Yuan: doctoral thesis, section 2.3, after Y. Koren (1980), Y. Koren & C.-C. Lo (1991), J.-H. Chin & T.-C. Lin (1997), "
    "C.-C. Lo & C. Y. Chung (1999), G. T.-C. Chiu & M. Tomizuka (2001), C. S. Chen & L. Y. Chen (2011)"
)
PUBLISHED = ()  # a survey: statements, no numbers


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce contouring-schemes`."""

    quick: bool = False
    """A fifth of the evaluations, feedback alone, without errors in masses and stiffness."""
    evaluations: int = 50
    """Of objective and gradient in one descent: one for the cascade, then two for every scheme."""

    def __post_init__(self):
        if self.evaluations < 3:
            raise ValueError(f"evaluations: needs at least three, received {self.evaluations}")


def run(settings: Settings, folder: Path) -> dict[str, Any]:
    """Tune and simulate everything; all that is found is in the summary, nothing is written to the folder."""
    plants = TUNED_ON if settings.quick else tuple(MODEL_ERRORS)
    bench = Bench(
        TUNED_ON, max(3, settings.evaluations // 5) if settings.quick else settings.evaluations
    )
    parts = [compared(bench, loops, plants) for loops in ((FEEDBACK,) if settings.quick else LOOPS)]
    summary: dict[str, Any] = {
        "source": SOURCE,
        "settings": asdict(settings),
        "tuned_on": TUNED_ON,
        "evaluations": bench.budget,
        "limits": dict(
            zip(bench.limits.names, np.asarray(bench.limits.bounds).tolist(), strict=True)
        ),
        **{key: [row for part in parts for row in part[key]] for key in ("tuning", "rows")},
    }
    summary["claims"] = claims(summary)
    return summary


def compared(bench: Bench, loops: str, plants: Sequence[str]) -> dict[str, Any]:
    """How every scheme was tuned around these loops, and its numbers on the true machines."""
    start, cascade = LOOPS[loops].start, SCHEMES[CASCADE]
    first = bench.tuned(cascade, LOOPS[loops], [cascade.around(start)])
    with ThreadPoolExecutor(2) as pool:  # one compiles while the other descends
        found = list(
            pool.map(lambda name: scheme_tuned(bench, loops, name, first, plants), SCHEMES)
        )
    untuned = rows("start", loops, cascade.build(cascade.around(start)), plants)
    return {
        "tuning": [tuning for tuning, _ in found],
        "rows": untuned + [row for _, made in found for row in made],
    }


def scheme_tuned(
    bench: Bench, loops: str, name: str, first: Tuned, plants: Sequence[str]
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """How one scheme was tuned, from the tuned cascade and from the thesis's gains, and its rows."""
    scheme = SCHEMES[name]
    tuned = bench.tuned(
        scheme,
        LOOPS[loops],
        [scheme.around(first.weights.cascade), scheme.around(LOOPS[loops].start, STRONG)],
    )
    return told(name, loops, tuned, first.history), rows(
        name, loops, scheme.build(tuned.weights), plants
    )


def told(name: str, loops: str, tuned: Tuned, before: list[Evaluated]) -> dict[str, Any]:
    """A tuned scheme in plain numbers; `best_um` is the best feasible objective after every evaluation, those of the cascade first."""
    gains, scheme = jax.tree.map(
        lambda leaf: np.asarray(leaf).tolist(), (vars(tuned.weights.cascade), tuned.weights.scheme)
    )
    values = [
        1e6 * row.objective if row.violation <= 0 and not row.diverged else np.inf
        for row in [*before, *tuned.history]
    ]
    return {
        "scheme": name,
        "loops": loops,
        "cascade": gains,
        "gains": list(scheme),
        "feasible": tuned.feasible,
        "diverged_points": tuned.diverged_points,
        "smooth_um": 1e6 * float(np.mean(tuned.metrics.rms_contour_error)),
        "best_um": np.minimum.accumulate(values).tolist(),
    }
