"""The simple loops of a drive beside the usual controller of a machine.

Whoever names no controller gets the simplest loop that is good enough. Every simple loop that suits
the machine is evaluated where it begins, on the contours, family and limits of the run. Where the
best of them may come within reach of the tuned controller it is tuned as well, and recommended
where it is as good.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from jcontour.app.catalogue.choices import UnreadFlagWarning, design_for, names_controller
from jcontour.app.designs.design import Design, plain_weights
from jcontour.app.designs.simple_loops import NOTCHED, simple_names
from jcontour.app.files.results.tuned_result import DriveLoop
from jcontour.app.flags.tuning import Tune
from jcontour.app.reports.drives import TERMS
from jcontour.app.runs.tuning.limits import lag_limit, named_limits
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.app.runs.tuning.searching import Searched
from tuning.objectives import AtMost, Outcome
from tuning.parameters import Chart
from tuning.point import FEASIBLE, evaluate_values, objective_value

AS_GOOD = 1.1  # times the error of the best: what is simpler is then recommended
PAYS = 1.5  # times the gain of the position loop: less is not worth a notch
REACH = 1.5  # times the error of the tuned controller: what a short descent may gain
STEPS = 6  # iterations of that descent
HALVINGS = 5  # of a gain that breaks a limit: at 1/32 it hardly follows
Search = Callable[[TuningRun], Searched | None]


class SimpleLoop(NamedTuple):
    """A simple loop where it begins."""

    run: TuningRun  # the tuning run with it in place of the controller
    error: float  # objective; infinite where a run or a loop is unstable
    violation: float  # largest ln(value / limit)
    sensitivity: float | None = None  # peak Ms of its loops, where they were looked at

    @property
    def kept(self) -> bool:
        """Whether it is stable within every limit."""
        return np.isfinite(self.error) and self.violation <= FEASIBLE


def simple_loops(run: TuningRun) -> list[SimpleLoop]:
    """The simple loops that suit the machine where they begin, the simplest first.

    None where the objective is no error of single runs, or the state is measured.
    """
    flags, machine = run.flags, run.machine
    linear = machine.linear
    other = run.design.fed != "outputs"
    if other or linear is None:
        return []
    try:
        names = simple_names(linear)
    except ValueError:  # coupled axes
        return []
    with warnings.catch_warnings():  # the flags are for those that read them
        warnings.simplefilter("ignore", UnreadFlagWarning)
        own = replace(flags, weights=(), alpha=None, beta=None, rho=None)
        designs = {name: design_for(machine, replace(own, controller=name)) for name in names}
    return [_at_start(of_design(run, one)) for one in worth_trying(designs)]


def is_chosen(flags: Tune) -> bool:
    """Whether the user names a controller or its weights: no other one is recommended then."""
    return names_controller(flags) or flags.free is not None


def worth_trying(designs: Mapping[str, Design]) -> list[Design]:
    """Those without a notch whose gain it hardly raises, and those with one where it does."""
    left_out = set()
    for plain, notched in NOTCHED.items():
        if plain in designs and notched in designs:
            gains = [np.max(designs[one].start["position"]) for one in (plain, notched)]
            left_out.add(plain if gains[1] > PAYS * gains[0] else notched)
    return [design for name, design in designs.items() if name not in left_out]


def best_simple(loops: Sequence[SimpleLoop]) -> SimpleLoop | None:
    """The simplest of them that is as good as any.

    Where none keeps every limit, that which exceeds them least; None where none is stable.
    """
    kept = [one for one in loops if one.kept]
    if not kept:
        sound = [one for one in loops if np.isfinite(one.error)]
        return min(sound, key=lambda one: one.violation, default=None)
    best = min(one.error for one in kept)
    return next(one for one in kept if one.error <= AS_GOOD * best)


def of_design(run: TuningRun, design: Design) -> TuningRun:
    """The run with another controller and a short search: the same contours, family and limits.

    But its own limit on the lag.
    """
    problem = replace(run.problem, build=design.complete, space=design.space)
    lag = lag_limit(run.machine, design, problem.references) | named_limits(run.flags)
    limits = run.limits | lag
    before = getattr(problem.limits, "before", None)
    problem = replace(problem, limits=AtMost(before, **limits))
    settings = replace(run.settings, starts=1, scatter=0, steps=STEPS)
    return replace(run, design=design, problem=problem, settings=settings, limits=limits)


def _at_start(run: TuningRun) -> SimpleLoop:
    """The loop with the fastest gain, from that of its start down, that keeps every limit.

    The first gain keeps the margins of the family; the limits of the machine may ask for less.
    Where none keeps them the loop is that of the start.
    """
    loop = first = _evaluated(run)
    for _ in range(HALVINGS):
        if loop.kept or not np.isfinite(loop.error):
            break
        design = loop.run.design
        slower = {**design.start, "position": design.start["position"] / 2}
        loop = _evaluated(replace(loop.run, design=design.replaced(start=slower)))
    return loop if loop.kept else first


def _evaluated(run: TuningRun) -> SimpleLoop:
    z = np.asarray(Chart(run.problem.space, run.start).coordinates())
    point = evaluate_values(run.problem, run.start, z)
    if point.diverged:
        return SimpleLoop(run, np.inf, np.inf)
    violation = float(np.max(point.limits, initial=-np.inf))
    return SimpleLoop(run, point.objective, violation, peak_sensitivity(point.outcome))


def peak_sensitivity(outcome: Outcome) -> float | None:
    """Peak Ms of the loops of a point; None where none was looked at."""
    return None if outcome.loops is None else float(np.max(outcome.loops.sensitivity))


def candidates(simple: SimpleLoop, searched: Searched | None, search: Search) -> list[Searched]:
    """What may be recommended: the simple loop, tuned, where it is as good, and the controller.

    Both where both keep the limits of the search.
    """
    if searched is not None and searched.tuned.feasible and simple.error > REACH * _error(searched):
        return [searched]
    tuned = search(simple.run)
    if tuned is None or searched is None:
        return [one for one in (tuned, searched) if one is not None]
    if not _recommended(tuned, searched):
        return [searched]
    return [tuned, searched] if searched.tuned.feasible else [tuned]


def _recommended(simple: Searched, searched: Searched) -> bool:
    """Whether the simple loop is as good as the controller within the limits."""
    if not simple.tuned.feasible:
        return not searched.tuned.feasible and simple.tuned.violation < searched.tuned.violation
    return not searched.tuned.feasible or _error(simple) <= AS_GOOD * _error(searched)


def _error(searched: Searched) -> float:
    """Objective of the tuned weights."""
    return objective_value(np.asarray(searched.run.problem.objective(searched.tuned.outcome)))


def drive_loop(searched: Searched, loops: Sequence[SimpleLoop]) -> DriveLoop | None:
    """The controller itself where a drive has it, else the best of the simple loops."""
    design, best = searched.run.design, best_simple(loops)
    if TERMS.issuperset(design.start):
        peak = peak_sensitivity(searched.tuned.outcome)
        weights, error, kept = (
            searched.tuned.weights,
            _error(searched),
            bool(searched.tuned.feasible),
        )
    elif best is not None:
        design, error, kept = best.run.design, best.error, best.kept
        weights, peak = design.start, best.sensitivity
    else:
        return None
    return DriveLoop(
        controller=design.name,
        weights=plain_weights(weights),
        error=error,
        tuned_error=_error(searched),
        kept=kept,
        sensitivity=peak,
    )


def simple_words(loops: Sequence[SimpleLoop]) -> str:
    """Simple loops where they begin, in one line."""
    return "; ".join(f"{one.run.design.name} {_words(one)}" for one in loops)


def _words(loop: SimpleLoop) -> str:
    if not np.isfinite(loop.error):
        return "unstable"
    beyond = "" if loop.kept else f", {100 * np.expm1(loop.violation):.2g} % beyond a limit"
    return f"{1e6 * loop.error:.4g} um{beyond}"
