"""Results of a tuning run: replays, margins, gap to the machine with all effects, history."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.analysis.sensitivity import LoopPeaks
from jcontour.analysis.uncertain_loops import BORNE
from jcontour.app.beside import Beside
from jcontour.app.designs.design import plain_weights
from jcontour.app.files.results.tuned_result import (
    HistoryPoint,
    PathMargins,
    RobustTest,
    Standstill,
    TunedContour,
    TunedResult,
)
from jcontour.app.files.results.verdict import ROUNDING, Message, warning
from jcontour.app.jobs.replays import Replay, Scenarios, replay
from jcontour.app.machines.machine import Fed, Machine
from jcontour.app.reports.rollouts import FamilyCurves
from jcontour.app.runs.checks.recommendation import (
    PAYS,
    Evidence,
    active_limits,
    clearly_worse,
    exceeded_most,
    flag_allowing,
    may_drift,
    run_warnings,
    verdict_on,
)
from jcontour.app.runs.checks.stated_limits import (
    family_limits,
    stated_limits,
)
from jcontour.app.runs.checks.trials import offset_lasts, path_margins, robust_test, standstill
from jcontour.app.runs.contour_summary import (
    family_metrics,
    loop_summary,
    peak_place,
    read_of,
)
from jcontour.app.runs.tuning.limits import (
    LeastKnown,
    family_curves,
    family_peaks,
    least_known,
)
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.app.runs.tuning.searching import Searched
from jcontour.app.runs.tuning.simple_loops import (
    SimpleLoop,
    best_simple,
    drive_loop,
    peak_sensitivity,
    simple_loops,
)
from jcontour.controller import Controller
from jcontour.simulation.evaluation import member
from tuning.objectives import LEAST
from tuning.parameters import Chart
from tuning.point import FEASIBLE, evaluate_point
from tuning.tuner import Tuned

SAFE = BORNE * (1 + ROUNDING)  # of what a response that is not known may take of a loop
PARTS = (0.8, 0.6, 0.4, 0.2)  # of the way from the start to the end of a search
SHOWN = 12  # contours: more are too many to look at


@dataclass(frozen=True)
class Trial:
    """Weights on the machines with all effects: every run, margins and curves, standstill.

    `name` is that of the controller where it is not the tuned one.
    """

    replay: Replay
    margins: PathMargins
    curves: FamilyCurves
    standstill: Standstill | None
    name: str = ""


def trial_of(run: TuningRun, tuned: Tuned, process: Beside | None = None) -> Trial:
    """Tuned weights tried on every contour and every plant."""
    known = None if run.flags.nominal_only else tuned.outcome.loops
    on = run.controller(tuned.weights), run.machine, run.scenarios, run.design.fed
    return tried(*on, known, process)


def suiting_all(
    searched: Searched, start: Trial, process: Beside | None = None
) -> tuple[Searched, Trial]:
    """The tuned weights and their trial, some way back to the start where some contour pays.

    A search sees the training contours alone. Where its end makes any contour worse than a usable
    start by more than `PAYS`, points of the straight line between both, in coordinates, are tried
    on all of them. Of those within the limits of the search where none is that much worse the one
    with the least geometric mean error is taken; the end itself where there is none.
    """
    run, tuned = searched.run, searched.tuned
    trial = trial_of(run, tuned, process)
    if not (tuned.feasible and keeps_limits(run, start)) or _suits(run, start, trial):
        return searched, trial
    chart = Chart(run.problem.space, run.start)
    first, last = (
        np.asarray(Chart(run.problem.space, one).coordinates())
        for one in (run.start, tuned.weights)
    )
    best, least = (searched, trial), np.inf
    for part in PARTS:
        z = first + part * (last - first)
        point = evaluate_point(run.problem, run.start, z)
        violation = float(np.max(point.limits, initial=-np.inf))
        if point.diverged or violation > FEASIBLE:
            continue
        weights = chart.weights(jnp.asarray(z))
        # no limit of the search stops it there
        other = tuned._replace(
            weights=weights, outcome=point.outcome, violation=violation, prices=[]
        )
        there = trial_of(run, other, process)
        typical = float(np.mean(np.log(_errors(run, there))))
        if typical < least and _suits(run, start, there):
            best, least = (replace(searched, tuned=other, part=part), there), typical
    return best


def recommended(
    tried: Sequence[tuple[Searched, Trial]], run: TuningRun, start: Trial
) -> tuple[Searched, Trial]:
    """Of candidates, the simplest first, the one to load, by their trials with all effects.

    That is one within every stated limit, with which no contour is clearly worse than with a
    usable start; among such the first unless the geometric mean error of another is `PAYS` times
    less.
    """
    if len(tried) == 1:
        return tried[0]
    usable, orders = keeps_limits(run, start), []
    for k, (searched, trial) in enumerate(tried):
        beyond = not keeps_limits(searched.run, trial)
        before, after = _errors(run, start), _errors(run, trial)
        pays = clearly_worse(after / before, after - before, _finest(run)).any()
        worse = usable and bool(pays)
        typical = float(np.exp(np.mean(np.log(after))))
        orders.append((beyond, worse, typical if k else typical / PAYS))
    return tried[orders.index(min(orders))]


def _suits(run: TuningRun, start: Trial, trial: Trial) -> bool:
    """Whether no contour is worse than with the start by more than `PAYS`."""
    before, after = _errors(run, start), _errors(run, trial)
    return bool(np.all((after <= PAYS * before) | (after - before <= _finest(run))))


def _errors(run: TuningRun, trial: Trial) -> np.ndarray:
    """RMS error of every contour, the worst of the family; infinite where one diverges."""
    metrics = trial.replay.metrics
    worst = np.max(getattr(metrics, f"rms_{run.machine.error}_error"), axis=1)
    return np.where(np.any(metrics.diverged, axis=1), np.inf, worst)


def _finest(run: TuningRun) -> float:
    """Difference of errors that the encoders can tell: a position's noise, coarsest axis [m]."""
    counts = 0.0 if run.machine.noisy_count is None else run.machine.noisy_count
    return float(np.max(counts)) / np.sqrt(12)


def robust_trial(run: TuningRun, tuned: Tuned, process: Beside) -> Callable[[], RobustTest | None]:
    """Tuned weights tried on random plants of the family, meanwhile."""
    controller, seed = run.controller(tuned.weights), run.flags.seed
    scenarios, fed = run.scenarios, run.design.fed
    if run.by_stretches:  # a thousand plants on the whole would take an hour
        seen = [True] * len(run.learned)
        scenarios = Scenarios.of(run.learned, seen, run.machine, fed, run.design.preview)
    return process.submit(robust_test, controller, run.machine, scenarios, fed, seed)


def start_trial(run: TuningRun, process: Beside) -> Callable[[], Trial]:
    """The design that the tuned one is compared with, with its own weights, tried meanwhile."""
    controller = run.before.complete(run.before.start)
    return process.submit(tried, controller, run.machine, run.scenarios, run.design.fed)


def baseline_trial(run: TuningRun, start: Trial, loops: Sequence[SimpleLoop]) -> Trial | None:
    """The best simple loop within every limit with its first gains, for a start of no use."""
    if keeps_limits(run, start):
        return None
    best = best_simple([one for one in loops or simple_loops(run) if one.kept])
    if best is None:
        return None
    simple = best.run
    controller = simple.controller(simple.start)
    trial = tried(controller, simple.machine, simple.scenarios, simple.design.fed)
    return replace(trial, name=simple.design.name) if keeps_limits(simple, trial) else None


def keeps_limits(run: TuningRun, trial: Trial) -> bool:
    """Whether a trial is that of a stable loop within every stated limit."""
    return not _unstable(trial) and all(one.kept for one in stated_limits(run, *_tests(trial)))


def tried(
    controller: Controller,
    machine: Machine,
    scenarios: Scenarios,
    fed: Fed,
    known: LoopPeaks | None = None,
    process: Beside | None = None,
) -> Trial:
    """A controller tried on every contour and every plant; `known` are its peaks, if they are.

    It is tried at standstill by the process meanwhile, where there is one.
    """
    submit = partial if process is None else process.submit
    at_rest = submit(standstill, controller, machine, fed)
    on = controller, machine, scenarios, fed
    peaks = family_peaks(*on) if known is None else known
    loops = path_margins(*on, peaks), family_curves(*on, peaks)
    return Trial(replay(controller, scenarios), *loops, at_rest())


def tuned_result(
    searched: Searched,
    trials: Mapping[str, Trial],
    robust: RobustTest | None,
    loops: Sequence[SimpleLoop],
    seconds: float,
) -> TunedResult:
    """The whole result; `trials` are those of the start, a baseline and the tuned weights."""
    run, tuned = searched.run, searched.tuned
    margins = trials["tuned"].margins
    replays = {name: trial.replay for name, trial in trials.items()}
    shown = shown_contours(run, replays)
    contours = [_contour(run, replays, c, c in shown) for c in range(len(run.scenarios.jobs))]
    error = run.machine.error
    limit = exceeded_most(run.problem, tuned)
    checks = {name: stated_limits(run, *_tests(trial)) for name, trial in trials.items()}
    verdict = verdict_on(
        Evidence(
            tuned=tuned,
            contours=contours,
            margins=margins,
            robust=robust,
            error=error,
            limits=[*checks["tuned"], *family_limits(robust)],
            start_limits=checks["start"],
            start_unstable=_unstable(trials["start"]),
            baseline="baseline" if "baseline" in trials else "start",
            delay=run.flags.min_delay_margin,
            alone=len(run.machine.family_names) == 1,
            finest=_finest(run),
            limit=limit,
            allowing=flag_allowing(limit, tuned.violation, run.flags, run.limits),
            feed_law=run.flags.feed_law,
            lasting=_offset_lasts(run, tuned) if may_drift(margins, contours) else 0.0,
            unknown=_unknown(run, tuned) if (margins.uncertainty or 0.0) > SAFE else None,
            unmeasured=_unmeasured(run.machine),
            warnings=[
                *run_warnings(run, tuned, margins, replays, searched.idle),
                *_baseline_words(trials),
                *_part_words(searched),
            ],
        )
    )
    weights = plain_weights(tuned.weights)
    return TunedResult(
        **loop_summary(run.machine, run.design.name),
        **run.design.settings(),
        limitable=run.design.limitable,
        files=run.design.files,
        start=plain_weights(run.before.start),
        weights=weights,
        weight_lines=run.design.lines(weights),
        feasible=bool(tuned.feasible),
        violation=float(tuned.violation) if np.isfinite(tuned.violation) else None,
        verdict=verdict,
        active=active_limits(tuned.prices, run.limits),
        robust=robust,
        standstill={name: one.standstill for name, one in trials.items() if one.standstill},
        limits=run.limits,
        evaluated_points=len(tuned.history),
        diverged_points=tuned.diverged_points,
        diverged_starts=tuned.diverged_starts,
        descents=searched.descents,
        plants=list(run.scenarios.plants),
        margins=margins,
        start_margins=trials["start"].margins,
        baseline_margins=trials["baseline"].margins if "baseline" in trials else None,
        contours=contours,
        training_samples=run.training_samples,
        seconds=seconds,
        sample_period=float(run.machine.model.dt),
        drive=drive_loop(searched, loops),
    )


def _tests(trial: Trial) -> tuple[Replay, PathMargins, Standstill | None]:
    """Results of a trial that limits are compared with."""
    return trial.replay, trial.margins, trial.standstill


def _unstable(trial: Trial) -> str:
    """Why a trial is that of no loop; empty where every run and every frozen loop is stable."""
    if np.any(trial.replay.metrics.diverged):
        return "a plant of the family diverges"
    return "" if trial.margins.stable else "a frozen loop is open or unstable"


def _baseline_words(trials: Mapping[str, Trial]) -> list[Message]:
    if "baseline" not in trials:
        return []
    name = trials["baseline"].name
    best = "with its first gains, the best simple loop within every limit"
    return [warning(f"the baseline is {name} {best}")]


def _part_words(searched: Searched) -> list[Message]:
    if searched.part == 1.0:
        return []
    way = f"{100 * searched.part:.0f} % of the way from the start to those that the search ended at"
    return [warning(f"the weights are {way}: farther, some contour becomes worse than the start")]


def _offset_lasts(run: TuningRun, tuned: Tuned) -> float:
    """Samples in which the tool comes back to the training paths, on the slowest of them."""
    plant, controller = run.machine.nominal(run.design.fed), run.controller(tuned.weights)
    references = jax.device_get(run.scenarios.references)
    trained = np.flatnonzero(run.scenarios.training).tolist()
    return max(offset_lasts(plant, controller, member(references, k)) for k in trained)


def _unmeasured(machine: Machine) -> list[str]:
    """Axes of which an identified machine has no measured line."""
    each = zip(machine.axes, machine.measured, strict=bool(machine.measured))
    return [name for name, lines in each if not lines.frequency.size]


def _unknown(run: TuningRun, tuned: Tuned) -> LeastKnown:
    """Where the tuned loops rest most on what is not known of the response."""
    controller = run.controller(tuned.weights)
    return least_known(controller, run.machine, run.scenarios, run.design.fed)


def shown_contours(run: TuningRun, replays: Mapping[str, Replay]) -> list[int]:
    """Contours that tables and figures show: all of a few; of many those that fared worst.

    Of training and of held-out contours the same number, by the ratio of the family's worst error
    to that of the start.
    """
    training = np.asarray(run.scenarios.training)
    if training.size <= SHOWN:
        return list(range(training.size))
    name = f"rms_{run.machine.error}_error"
    start, tuned = (np.max(getattr(replays[k].metrics, name), axis=1) for k in ("start", "tuned"))
    lost = np.any(replays["tuned"].metrics.diverged, axis=1)
    order = np.argsort(-np.where(lost, np.inf, tuned / np.maximum(start, LEAST)))
    half = SHOWN // 2
    kept = [row for seen in (True, False) for row in order[training[order] == seen][:half]]
    return sorted(int(row) for row in kept)


def _contour(
    run: TuningRun, replays: Mapping[str, Replay], index: int, shown: bool
) -> TunedContour:
    scenarios = run.scenarios
    job = scenarios.jobs[index]
    return TunedContour(
        name=job.name,
        training=bool(scenarios.training[index]),
        samples=job.samples,
        metrics={name: family_metrics(one, index) for name, one in replays.items()},
        read=read_of(scenarios.jobs[index], scenarios.references.dt),
        peak=peak_place(scenarios, replays["tuned"], index, run.machine.error),
        shown=shown,
        feed_law=job.feed_law,
    )


def history_of(run: TuningRun, tuned: Tuned) -> list[HistoryPoint]:
    """Every evaluated point; error and increment are the worst over contours and family."""
    chart = Chart(run.problem.space, run.start)
    error = f"rms_{run.machine.error}_error"
    return [
        HistoryPoint(
            descent=row.start,
            weights=plain_weights(chart.weights(jnp.asarray(row.z))),
            objective=row.objective,
            violation=row.violation,
            diverged=row.diverged,
            rms_error=float(np.max(getattr(row.outcome.metrics, error))),
            rms_increment=float(np.max(row.outcome.metrics.rms_increment)),
            sensitivity=peak_sensitivity(row.outcome),
        )
        for row in tuned.history
    ]
