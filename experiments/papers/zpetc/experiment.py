"""Smith & Lee 1990: ZPETC with an integrator and adaptive ZPETC on a three-link manipulator.

The tables of errors were measured on the manipulator. Models, filters and equations are checked to
the printed digits. Our runs take a path, a geometry and model errors that are chosen; the printed
limit of the current is kept where Table 2 is judged, friction is assumed there.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from experiments.papers.zpetc import runs

SOURCE = (
    "A. Smith, K.-M. Lee: An Experimental Investigation of Two Digital Tracking Controllers: "
    "Adaptive and Non-Adaptive. ASME Winter Annual Meeting (1990)"
)


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce zpetc`."""

    quick: bool = False
    """Four integral times in place of nine."""


@dataclass(frozen=True)
class Result:
    """Models, filters and equations, and runs of one leg."""

    models: tuple[runs.Model, ...]
    prefilters: dict[str, tuple[float, ...]]  # coefficients of (8) by what they are made from
    slow_pole: float  # of the printed loop [rad/s]
    corrected_5: float  # difference between (5), corrected, and a simulation at 3 Hz
    printed_5: float  # the same as printed
    units: tuple[runs.Units, ...]
    gain_error: runs.GainError
    path_mm: Float[np.ndarray, "T legs"]  # lengths of the legs from the start, every 3 ms
    errors_um: dict[str, Float[np.ndarray, " T"]]  # of drawn runs
    integral: tuple[runs.IntegralRun, ...]
    limited: tuple[runs.IntegralRun, ...]  # the same with the current's limit, and some frictions
    adaptive: tuple[runs.AdaptiveRun, ...]


def run(settings: Settings) -> Result:
    """Simulate everything."""
    times = (None, 0.002, 0.01, runs.BEST_TIME, 0.2) if settings.quick else runs.INTEGRAL_TIMES
    poor, best = runs.TRUTHS[2], runs.BEST_TIME
    adaptive = runs.adaptive(runs.STARTS[0], runs.TRACES[0])
    corrected, printed = runs.equation_5()
    return Result(
        models=runs.models(),
        prefilters={
            f"servo pole {runs.FITTED_POLE:.2f}": runs.prefilter_of(runs.fitted_loop()),
            "from (7) as printed": runs.prefilter_of(runs.printed_loop()),
        },
        slow_pole=float(-np.log(float(runs.LOOP_3_MS.printed_poles[1])) / runs.FAST),
        corrected_5=corrected,
        printed_5=printed,
        units=runs.units(),
        gain_error=runs.gain_left(),
        path_mm=1e3 * runs.legs(runs.FAST),
        errors_um={
            "Fig. 8: no integrator, gain x1.5": runs.errors(runs.tracking(None), poor, runs.FAST),
            f"Fig. 9: T_i = {best:g} s, gain x1.5": runs.errors(
                runs.tracking(best), poor, runs.FAST
            ),
            "adaptive, gain x1.5": runs.errors(adaptive, poor, runs.SLOW),
        },
        integral=runs.integral_runs(times=times),
        limited=tuple(
            row for one in runs.FRICTIONS for row in runs.integral_runs(times=times, friction=one)
        ),
        adaptive=runs.adaptive_runs(),
    )
