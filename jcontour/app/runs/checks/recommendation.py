"""Whether tuned weights may be loaded: every reason against it and every warning, with a remedy."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from jcontour.analysis.uncertain_loops import BORNE
from jcontour.app.files.results.run_metrics import METRICS, RunMetrics
from jcontour.app.files.results.tuned_result import (
    ActiveLimit,
    PathMargins,
    RobustTest,
    TunedContour,
)
from jcontour.app.files.results.verdict import LimitCheck, Message, Verdict, reason, warning
from jcontour.app.flags.shared import Aimed
from jcontour.app.jobs.replays import Replay, Scenarios, replay
from jcontour.app.runs.checks.run_checks import lost_numbers, machine_warnings
from jcontour.app.runs.tuning.limits import LIMITS, LeastKnown
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.simulation.evaluation import stack_plants
from tuning.objectives import COUNT_NOISE, LATE, RATIO, USE_LIMITS
from tuning.problem import Problem
from tuning.tuner import Price, Tuned

START, TUNED = "start", "tuned"  # loops of a contour's metrics
# limits that a calmer motion keeps
OF_AXES = ("speed of", "acceleration of", "control of", "control increment of")
WORSE = 1.01  # ratio to the loop compared with: less is no change
PAYS = 1.1  # from which on one contour pays for the others: what is as good keeps below it
ASKED = {"increment": "change of its control"}  # limit that is called otherwise
FLAGS = {  # limit on metrics: flag that allows more
    metric: f"--{name.replace('_', '-')}" for name, metric in LIMITS.items()
}
RESTLESS = 5.0  # times the change of the control from sample to sample at the start
TRY_LESS = (  # a loop overshoots: the number that is enough is found by trying
    "try 10 % less feed or acceleration, --feed-mm-per-min or --acceleration, and again until "
    "this reason is gone"
)
ALONE = "the weights were tried on a single plant, and no machine is exactly as its model says"
STATED = (
    'state what is not known, "uncertainty" in a machine file, UNCERTAINTY in a Python file, as in '
    '{"gain": 0.05, "delay": 1}'
)
CHEAP = 1e-3  # price below which a limit does not stop anything
SLOWEST = 10.0  # longest contours that an error may take to die out to a third
MUCH_LAG = 5.0  # times the tracking error of the start, from which on there is a warning
OPEN = "a control is at its limit, or has a gain of zero, and the loop is open"


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Everything that is known of tuned weights before anybody loads them."""

    tuned: Tuned  # end of the search
    contours: Sequence[TunedContour]  # start against tuned, on the machine with all effects
    margins: PathMargins  # of the tuned loop
    robust: RobustTest | None  # corners and random plants of the family; None of a single plant
    error: str  # that counts, "contour" or "tracking"
    limits: Sequence[LimitCheck] = ()  # every stated limit, with what the tuned weights reach
    start_limits: Sequence[LimitCheck] = ()  # the same of the start
    start_unstable: str = ""  # why the start is no loop at all; empty where it is one
    # loop of `contours` that the tuned one has to be no worse than; empty where there is none
    baseline: str = START
    delay: int = 0  # margin that is asked for [samples]
    alone: bool = False  # whether the weights were tried on a single plant
    finest: float = 0.0  # difference of errors that the encoders of all axes can tell [m]
    limit: str = ""  # bound of the search that they exceed most; empty where they exceed none
    allowing: str = ""  # flag and value that allow what the weights reach, see `flag_allowing`
    feed_law: str = "jerk"  # of the motions
    lasting: float = 0.0  # samples in which an offset of the tool dies out to a third
    # where the loops rest most on what is not known of the response, where that is too much
    unknown: LeastKnown | None = None
    # axes of a machine from a record whose response the record does not show
    unmeasured: Sequence[str] = ()
    warnings: Sequence[Message] = ()  # what to know beside all this

    @property
    def compared(self) -> str:
        """Loop that the tuned one is compared with; empty where the start breaks a limit."""
        start_kept = not self.start_unstable and all(one.kept for one in self.start_limits)
        return "" if self.baseline == START and not start_kept else self.baseline


def verdict_on(seen: Evidence) -> Verdict:
    """Verdict on tuned weights: the gravest reasons first, then the comparison, then the limits."""
    messages = [*_unsound(seen), *seen.warnings, *_comparison(seen), *_start(seen)]
    # What helps where limits are not kept
    beyond = [one.name for one in seen.limits if not one.kept]
    remedies = []
    if any(name.startswith(OF_AXES) for name in beyond):
        other = "" if seen.feed_law == "jerk" else "; or with a toolpath file --feed-law jerk"
        remedies.append(
            "a motion that asks for less keeps the limit, and so may tuning on that contour as "
            f"well; {TRY_LESS}{other}"
        )
    if any("encoder counts" in name for name in beyond):
        remedies.append("less --max-count-noise makes the control calmer, finer encoders as well")
    return Verdict.of(seen.limits, messages, remedies)


def _unsound(seen: Evidence) -> Iterator[Message]:
    """Reasons against the loop itself, whatever it is compared with."""
    margins, robust = seen.margins, seen.robust
    peak = np.inf if margins.sensitivity is None else margins.sensitivity
    more = f"ask for more margin, --max-sensitivity {max(1.1, min(1.7, round(0.85 * peak, 1))):g}"
    lost = [one.name for one in seen.contours if one.metrics[TUNED].worst.diverged]
    if lost:
        yield reason(f"a plant of the family diverges on {', '.join(lost)}", more)
    if not margins.stable:
        yield reason(
            "with its gains frozen at a point of the training paths the loop is open or unstable",
            "keep a margin, --max-sensitivity 2",
        )
    if robust is not None and robust.diverged:
        yield reason(
            f"{robust.diverged} of {robust.members} random plants of the family diverge", more
        )
    if seen.alone:
        yield reason(ALONE, STATED)
    longest = max(one.samples for one in seen.contours)
    if seen.lasting >= SLOWEST * longest:
        back = f"takes {seen.lasting:.2g} samples to come back"
        yield reason(
            "the feedback does next to nothing: a tool off its path "
            f"{back if np.isfinite(seen.lasting) else 'stays there'}, the longest contour has "
            f"{longest} samples",
            "begin at larger gains (--weights)",
        )
    if margins.stable and margins.delay_samples < seen.delay:
        yield reason(
            f"the nominal loop bears {margins.delay_samples} samples of delay at a point of the "
            f"training paths, {seen.delay} are asked for",
            "keep a margin, --max-sensitivity 2",
        )
    if not seen.tuned.feasible:
        yield reason(
            "no weights were found within every limit; these exceed that on the "
            f"{seen.limit.removesuffix('_use').replace('_', ' ')} by "
            f"{100 * np.expm1(seen.tuned.violation):.3g} %",
            _search_remedy(seen.limit, seen.allowing),
        )
    if seen.unmeasured:
        yield reason(
            f"nothing of the response of {', '.join(seen.unmeasured)} is measured: the record does "
            "not excite it",
            "record what jcontour identify --excite writes",
        )
    if (place := seen.unknown) is not None:
        percent = f"{100 * place.relative:.3g} %"
        off = percent if place.relative < 2 else f"{place.relative:.3g} times"
        yield reason(
            f"at {place.hertz:.3g} Hz the machine may answer {off} off its model, and the "
            f"complementary sensitivity there is {place.complementary:.2g}: at most "
            f"{BORNE / place.relative:.2g} is safe; record what shows the response there",
            "jcontour identify --excite",
        )


def _search_remedy(limit: str, allowing: str) -> str:
    """What may be done about a limit of the search that no weights keep."""
    if limit in USE_LIMITS:
        words = limit.removesuffix("_use")
        asked = ASKED.get(words, words)
        return f"the motion asks for more {asked} than the machine has; {TRY_LESS}"
    if limit == LATE:
        return "a loop does not bear the delay that --min-delay-margin asks for; ask for less"
    if not allowing:
        return ""
    known = {
        COUNT_NOISE: "the rounding of the encoders moves the control more than that; "
        f"{allowing} allows these weights, finer encoders need less",
        "peak_sensitivity": f"less margin allows these weights, {allowing}",
        RATIO: f"a training contour stays worse than was asked for; {allowing} allows it",
    }
    return known.get(limit, f"lower the feed, or allow these weights, {allowing}")


def _start(seen: Evidence) -> Iterator[Message]:
    """Why the start is no loop to load, with what the tuned weights make of it."""
    tuned = {one.name: one for one in seen.limits}
    why = [seen.start_unstable] if seen.start_unstable else []
    for one in seen.start_limits:
        if not one.kept:
            after = tuned.get(one.name)
            why.append(f"{one.name} {one.size}" + (f"; tuned {after.shown:.4g}" if after else ""))
    yield from (warning(f"start: not usable, {line}") for line in why)
    if why and not seen.compared:
        yield warning("compared with no other loop: no simple loop keeps every limit as it begins")


def _comparison(seen: Evidence) -> Iterator[Message]:
    """Contours that the tuned weights make worse, held-out ones first, and restless controls.

    What grows by no more than the encoders can tell, by a tenth, or by less than the geometric mean
    of all contours falls, is a warning. Weights that gain less than the encoders can tell and make
    the control restless are not worth it.
    """
    if not seen.compared:
        return
    worst = [(one.metrics[seen.compared].worst, one.metrics[TUNED].worst) for one in seen.contours]
    ratios, grown = {}, {}  # of the family's worst errors, where both loops follow
    for contour, pair in zip(seen.contours, worst, strict=True):
        before, after = (metrics.rms(seen.error) for metrics in pair)
        if not any(metrics.diverged for metrics in pair):
            ratios[contour.name], grown[contour.name] = after / before, after - before
    counts = f"the rounding of the encoders, {1e6 * seen.finest:.2g} um"
    worse = [name for name, ratio in ratios.items() if ratio > WORSE]
    typical = float(np.exp(np.mean(np.log(list(ratios.values()))))) if ratios else 1.0
    pays = clearly_worse(
        np.array(list(ratios.values())), np.array(list(grown.values())), seen.finest
    )
    clearly = [name for name, one in zip(ratios, pays, strict=True) if one and seen.tuned.feasible]
    for training, words in ((False, "held-out"), (True, "training")):
        shown = [one.name for one in seen.contours if one.training is training]
        named = [f"{name} x {ratios[name]:.2f}" for name in shown if name in clearly]
        if named:
            yield reason(
                f"worse than the {seen.compared} on {words} contours: {', '.join(named)}",
                "train on contours like them, or so that none pays for the others, "
                "--max-error-ratio 1",
            )
    in_all = seen.tuned.feasible and typical > WORSE and not clearly
    if in_all:
        yield reason(
            f"worse than the {seen.compared} in all: the geometric mean of the worst errors of all "
            f"contours is x {typical:.2f}",
            f"keep the {seen.compared}",
        )
    hardly = [f"{n} x {ratios[n]:.2f}" for n in worse if grown[n] <= seen.finest]
    if hardly and not clearly and not in_all:
        yield warning(f"worse than the {seen.compared} by less than {counts}: {', '.join(hardly)}")
    little = [f"{n} x {ratios[n]:.2f}" for n in worse if grown[n] > seen.finest]
    if little and not clearly and not in_all:
        mean = f", while the geometric mean of all contours is x {typical:.2f}"
        paid = max(ratios[name] for name in worse) > PAYS
        yield warning(
            f"a little worse than the {seen.compared}{mean if paid else ''}: {', '.join(little)}"
        )
    if len(ratios) < len(worst) or min(grown.values()) < -seen.finest:
        return  # one diverges, or gains what the encoders can tell
    start, tuned = max(worst, key=lambda pair: _times(*pair))
    if _times(start, tuned) >= RESTLESS:
        yield reason(
            f"no contour becomes better by more than {counts}, and the control changes up to "
            f"{_times(start, tuned):.2g} times as much from sample to sample",
            f"keep the {seen.compared}, or limit that change, "
            f"--max-rms-increment {2 * start.rms_increment:.2g}",
        )


def clearly_worse(
    ratio: Float[np.ndarray, " c"], grown: Float[np.ndarray, " c"], finest: float
) -> Bool[np.ndarray, " c"]:
    """Contours that pay for others: their error grows by more than the geometric mean falls.

    And by more than `PAYS` and what the encoders can tell.

    Args:
        ratio: error of every contour over that before.
        grown: their difference [m].
        finest: difference that the encoders can tell [m].
    """
    gained = float(np.exp(-np.mean(np.log(np.maximum(ratio, 1e-3))))) if ratio.size else 1.0
    return (ratio > max(PAYS, gained)) & (grown > finest)


def _times(start: RunMetrics, tuned: RunMetrics) -> float:
    """Change of the control from sample to sample, tuned over start; 0 where it stands still."""
    return tuned.rms_increment / start.rms_increment if start.rms_increment else 0.0


def may_drift(margins: PathMargins, contours: Sequence[TunedContour]) -> bool:
    """Whether something in the frozen loops lasts longer than any path: the tool, or not."""
    longest = max(one.samples for one in contours)
    return margins.stable and (1 - margins.spectral_radius) * SLOWEST * longest <= 1


def exceeded_most(problem: Problem, tuned: Tuned) -> str:
    """Name of the limit that the weights exceed most; empty where they exceed none."""
    if tuned.feasible:
        return ""
    entries = problem.limit_entries(tuned.outcome)
    return entries[int(np.argmax(problem.limits(tuned.outcome)))].name


def flag_allowing(limit: str, violation: float, flags: Aimed, limits: Mapping[str, float]) -> str:
    """Flag and value that allow what weights beyond a limit reach; empty where no flag does.

    The value is (bound) exp(violation), rounded up to three digits.

    Args:
        limit: name of the one that is exceeded most.
        violation: ln(value / bound).
        flags: of the run.
        limits: bounds by name, SI units.
    """
    bound, flag = limits.get(limit), FLAGS.get(limit)
    if bound is None or not np.isfinite(violation):
        return ""
    if limit == "rms_control" and flags.max_effort is not None:
        flag, bound = "--max-effort", flags.max_effort
    elif flag is not None:
        bound *= METRICS[limit].factor
    elif limit == COUNT_NOISE:
        assert flags.max_count_noise is not None  # or there was no such limit
        flag, bound = "--max-count-noise", flags.max_count_noise
    else:
        flag = {RATIO: "--max-error-ratio", "peak_sensitivity": "--max-sensitivity"}.get(limit)
    if flag is None:
        return ""
    value = bound * np.exp(violation)
    place = 10.0 ** (2 - np.floor(np.log10(value)))
    return f"{flag} {np.ceil(value * place * (1 - 1e-12)) / place:.6g}"


def active_limits(prices: Sequence[Price], bounds: Mapping[str, float]) -> list[ActiveLimit]:
    """Limits that stop further improvement, the dearest first.

    Entries of one limit, for different contours and plants, are loosened together.
    """
    totals = {name: sum(one.price for one in prices if one.name == name) for name in bounds}
    dear = sorted((name for name in totals if totals[name] > CHEAP), key=lambda n: -totals[n])
    return [ActiveLimit(name=name, bound=bounds[name], price=totals[name]) for name in dear]


def run_warnings(
    run: TuningRun,
    tuned: Tuned,
    margins: PathMargins,
    replays: dict[str, Replay],
    idle: Sequence[str] = (),
) -> Iterator[Message]:
    """Everything to know of a run before trusting its weights."""
    if tuned.stabilised:
        yield warning("the start was unstable: the tuner first made every loop stable")
    if not tuned.stationary:
        yield warning(
            "the search ended before the gain that it sees was used up",
            "--steps 60, or --every-start, may find better weights",
        )
    if tuned.diverged_points:
        points = f"{tuned.diverged_points} of {len(tuned.history)} evaluated points"
        yield warning(f"{points} had a diverging plant and were rejected")
    if tuned.diverged_starts:
        yield warning(
            f"{tuned.diverged_starts} descents could not begin because their start diverges"
        )
    if tuned.stabilised:
        yield from (warning(f"with the start, {line}") for line in lost_at_start(run))
    if run.design.learns:
        yield warning(
            "the controller learns while it runs: its margins are those of the loop that it begins "
            "with"
        )
    asked, dt = run.flags.min_delay_margin, run.machine.model.dt
    longest = max(job.samples for job in run.scenarios.jobs)
    yield from margin_warnings(margins, run.machine.unknown_delay, longest, dt, asked)
    yield from machine_warnings(replays[TUNED], run.scenarios, run.machine)
    if run.machine.error == "contour":  # the tracking error itself is tuned and shown otherwise
        yield from lag_warnings(replays, run.scenarios)
    if idle:
        have, are = ("has", "is") if len(idle) == 1 else ("have", "are")
        yield warning(
            f"{', '.join(idle)} {have} no effect on these runs and {are} left at the start: does "
            "the controller read it?"
        )


def lost_at_start(run: TuningRun) -> list[str]:
    """A line where the start of a search meets NaN, on the smooth machines that it sees."""
    machine, design = run.machine, run.design
    family = stack_plants(machine.smooth_family(design.fed))
    smooth = run.scenarios._replace(family=family)
    return lost_numbers(replay(design.complete(design.start), smooth), smooth)[:1]


def margin_warnings(
    margins: PathMargins, unknown_delay: int, longest: int, dt: float, asked: int = 0
) -> Iterator[Message]:
    """Loops that are open, unstable, or so with a little more delay, and modes that last.

    No run shows a mode that lasts longer than it. It may be that of an observer that finds a load,
    or of an integral part, as well as the tool's.

    Args:
        margins: of the tuned loops.
        unknown_delay: that the machine may have [samples].
        longest: samples of the longest contour.
        dt: sample period [s].
        asked: delay margin that the flags ask for [samples]: losing it is a reason, no warning.
    """
    if margins.contours_without_margins:
        where = f"every probed point of {', '.join(margins.contours_without_margins)}"
        yield warning(f"there are no margins: at {where} {OPEN}")
    elif margins.spectral_radius >= 1:
        yield warning("with its gains frozen at a point of the training paths the loop is unstable")
    elif margins.delay_samples < unknown_delay:
        late = f"{margins.delay_samples + 1} sample{'s' if margins.delay_samples else ''} late"
        yield warning(
            f"{late}, as this machine may be, the loop frozen at a point of the training paths is "
            "unstable: longer runs may ring"
        )
    elif margins.delay_samples == 0 and not asked:
        yield warning(
            "one more sample of delay makes the loop unstable",
            "--min-delay-margin 1 keeps it from that",
        )
    if margins.probes_left_out:
        many = "s" if margins.probes_left_out > 1 else ""
        yield warning(
            f"margins leave out {margins.probes_left_out} probed point{many} where {OPEN}"
        )
    if margins.stable and margins.spectral_radius > np.exp(-1 / longest):
        lasts = -1 / np.log(margins.spectral_radius)
        yield warning(
            f"the slowest mode of the loop dies out to a third in {lasts:.4g} samples "
            f"({1e3 * dt * lasts:.3g} ms), the longest contour has {longest}: what a constant load "
            "does may last longer than these runs show; a longer part shows it"
        )


def lag_warnings(replays: dict[str, Replay], scenarios: Scenarios) -> Iterator[Message]:
    """Tell where the tuned tool lags far more than before.

    Contour error alone is also small for a tool that hardly moves.
    """
    before = 1e6 * np.asarray(replays["start"].metrics.rms_tracking_error).max(axis=1)
    after = 1e6 * np.asarray(replays["tuned"].metrics.rms_tracking_error).max(axis=1)
    worst = int(np.argmax(after / before))
    if after[worst] >= MUCH_LAG * before[worst]:
        lag = f"{after[worst]:.4g} um behind on {scenarios.jobs[worst].name}"
        yield warning(
            f"the tool lags {lag} (start: {before[worst]:.4g} um), and contour error alone does "
            "not mind",
            "limit it with --max-tracking-error-um",
        )
