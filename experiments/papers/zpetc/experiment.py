"""Smith & Lee 1990: ZPETC with an integrator and adaptive ZPETC on a three-link manipulator.

The tables of errors were measured on the manipulator, with friction and a current limit that the
paper does not give. Models, filters and equations are checked to the printed digits. Our runs take
a path, a geometry and model errors that are chosen.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from experiments.papers.zpetc.claims import claims
from experiments.papers.zpetc.figures import draw
from experiments.papers.zpetc.published import (
    BEST_TIME,
    FIRST_ORDER,
    LOOP_3_MS,
    LOOP_17_MS,
    PLANT_3_MS,
    PLANT_17_MS,
    PREFILTER,
    TABLE_2,
)
from experiments.papers.zpetc.result import Prefilter, Result
from experiments.papers.zpetc.runs import (
    FAST,
    FITTED_POLE,
    INTEGRAL_TIMES,
    STARTS,
    TRACES,
    TRUTHS,
    adaptive,
    adaptive_runs,
    equation_5,
    errors,
    fitted_loop,
    gain_left,
    integral_runs,
    legs,
    models,
    prefilter_of,
    printed_loop,
    tracking,
    units,
)
from experiments.papers.zpetc.runs import SLOW as SLOW_PERIOD
from experiments.papers.zpetc.tables import show

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = (
    "A. Smith, K.-M. Lee: An Experimental Investigation of Two Digital Tracking Controllers: "
    "Adaptive and Non-Adaptive. ASME Winter Annual Meeting (1990)"
)
PUBLISHED = (PLANT_3_MS, LOOP_3_MS, PREFILTER, PLANT_17_MS, LOOP_17_MS, FIRST_ORDER, TABLE_2)


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce zpetc`."""

    quick: bool = False
    """Three integral times in place of ten."""


def run(settings: Settings, folder: Path) -> Result:
    """Simulate everything; nothing is written to the folder."""
    times = (None, 0.002, 0.01, BEST_TIME) if settings.quick else INTEGRAL_TIMES
    poor = TRUTHS[2]
    drawn = {
        "Fig. 8: no integrator, gain x1.5": errors(tracking(None), poor, FAST),
        f"Fig. 9: T_i = {BEST_TIME:g} s, gain x1.5": errors(tracking(BEST_TIME), poor, FAST),
        "adaptive, gain x1.5": errors(adaptive(STARTS[0], TRACES[0]), poor, SLOW_PERIOD),
    }
    corrected, printed = equation_5()
    found = Result(
        source=SOURCE,
        settings=asdict(settings),
        models=models(),
        prefilters=(
            Prefilter(f"servo pole {FITTED_POLE:.2f}", prefilter_of(fitted_loop()), PREFILTER),
            Prefilter("from (7) as printed", prefilter_of(printed_loop()), PREFILTER),
        ),
        slow_pole=float(-np.log(float(LOOP_3_MS.poles[1])) / FAST),
        corrected_5=corrected,
        printed_5=printed,
        units=units(),
        gain_error=gain_left(),
        path_mm=1e3 * legs(FAST),
        errors_um=drawn,
        integral=integral_runs(times=times),
        adaptive=adaptive_runs(),
    )
    return replace(found, claims=claims(found))
