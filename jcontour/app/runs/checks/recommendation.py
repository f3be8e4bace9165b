"""Whether tuned weights may be loaded: every reason against it and every warning, with a remedy."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jcontour.analysis.uncertain_loops import BORNE
from jcontour.app.files.results.run_metrics import RunMetrics
from jcontour.app.files.results.tuned_result import (
    ActiveLimit,
    PathMargins,
    RobustTest,
    TunedContour,
    rms_error,
)
from jcontour.app.files.results.verdict import LimitCheck, Verdict
from jcontour.app.flags.shared import Aimed
from jcontour.app.jobs.replays import Replay, Scenarios
from jcontour.app.runs.checks.machine_limits import drives_at_limits_in_rapids
from jcontour.app.runs.checks.run_checks import (
    arrival_warnings,
    limits_exceeded_by_plan,
    lost_at_start,
    swing_warnings,
)
from jcontour.app.runs.tuning.family_loops import LeastKnown
from jcontour.app.runs.tuning.limits import LIMITS
from jcontour.app.runs.tuning.problem import TuningRun
from tuning.objectives import COUNT_NOISE, LATE, RATIO, USE_LIMITS
from tuning.problem import Problem
from tuning.tune import Price, Tuned

START, TUNED = "start", "tuned"  # loops of a contour's metrics
OF_AXES = (
    "speed of",
    "acceleration of",
    "control of",
    "control increment of",
)  # limits that a calmer motion keeps
WORSE = 1.01  # ratio to the loop compared with: less is no change
ASKED = {"increment": "change of its control"}  # limit that is called otherwise
FLAGS = {  # limit on metrics: flag that allows more
    metric: f"--{name.replace('_', '-')}" for name, (metric, _) in LIMITS.items()
}
FACTORS = dict(LIMITS.values())  # limit on metrics: from the unit of its flag to SI
RESTLESS = 5.0  # times the change of the control from sample to sample at the start
TRY_LESS = (  # a loop overshoots: the number that is enough is found by trying
    "try 10 % less feed or acceleration, --feed-mm-per-min or --acceleration, and again until "
    "this reason is gone"
)
ALONE = (
    "the weights were tried on a single plant, and no machine is exactly as its model says: state "
    'what is not known, "uncertainty" in a machine file, UNCERTAINTY in a Python file, as in '
    '{"gain": 0.05, "delay": 1}'
)
CHEAP = 1e-3  # price below which a limit does not stop anything
SLOWEST = 10.0  # longest contours that an error may take to die out to a third
MUCH_LAG = 5.0  # times the tracking error of the start, from which on there is a warning
OPEN = "a control is at its limit, or has a gain of zero, and the loop is open"


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Everything that is known of tuned weights before anybody loads them.

    Attributes:
        tuned: end of the search.
        contours: start against tuned, on the machine with all effects.
        margins: of the tuned loop.
        robust: corners and random plants of the family; None where it is a single plant.
        error: the error that counts, "contour" or "tracking".
        limits: every stated limit, with what the tuned weights reach.
        start_limits: the same of the start.
        start_unstable: why the start is no loop at all; empty where it is one.
        baseline: loop of `contours` that the tuned one has to be no worse than; empty where
            there is none.
        delay: margin that is asked for [samples].
        alone: whether the weights were tried on a single plant.
        finest: difference of errors that the encoders of all axes can tell [m].
        limit: bound of the search that the weights exceed most; empty where they exceed none.
        allowing: flag and value that allow what the weights reach, see `flag_allowing`.
        feed_law: of the motions.
        lasting: samples in which an offset of the tool dies out to a third.
        unseen: limits that plants exceed which the tuner did not see, one line each.
        unknown: where the loops rest most on what is not known of the response, where they rest on
            too much of it.
        warnings: what to know beside all this.
    """

    tuned: Tuned
    contours: Sequence[TunedContour]
    margins: PathMargins
    robust: RobustTest | None
    error: str
    limits: Sequence[LimitCheck] = ()
    start_limits: Sequence[LimitCheck] = ()
    start_unstable: str = ""
    baseline: str = START
    delay: int = 0
    alone: bool = False
    finest: float = 0.0
    limit: str = ""
    allowing: str = ""
    feed_law: str = "jerk"
    lasting: float = 0.0
    unseen: Sequence[str] = ()
    unknown: LeastKnown | None = None
    warnings: Sequence[str] = ()

    @property
    def compared(self) -> str:
        """Loop that the tuned one is compared with; empty where the start breaks a limit."""
        start_kept = not self.start_unstable and all(one.kept for one in self.start_limits)
        return "" if self.baseline == START and not start_kept else self.baseline


def verdict_on(seen: Evidence) -> Verdict:
    """Verdict on tuned weights: the gravest reasons first, then the limits, then the comparison."""
    worse = _worse(seen) if seen.tuned.feasible else []
    return Verdict.of(
        seen.limits,
        [
            *_unstable(seen.contours, seen.margins, seen.robust),
            *([ALONE] if seen.alone else []),
            *_adrift(seen.lasting, seen.contours),
            *_late(seen.margins, seen.delay),
            *_infeasible(seen.tuned, seen.limit, seen.allowing),
            *_unknown(seen.unknown),
            *seen.unseen,
            *worse,
            *_restless(seen),
        ],
        [*start_lines(seen), *seen.warnings, *([] if worse else hardly_worse(seen))],
        _help_with(seen.limits, seen.feed_law),
    )


def start_lines(seen: Evidence) -> list[str]:
    """Why the start is no loop to load, with what the tuned weights make of it."""
    tuned = {one.name: one for one in seen.limits}
    why = [seen.start_unstable] if seen.start_unstable else []
    for one in seen.start_limits:
        if not one.kept:
            after = tuned.get(one.name)
            now = "" if after is None else f"; tuned {after.value:.4g}"
            why.append(f"{one.name} {one.size}{now}")
    lines = [f"start: not usable, {line}" for line in why]
    if lines and not seen.compared:
        lines.append("compared with no other loop: no simple loop keeps every limit as it begins")
    return lines


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
        bound /= FACTORS[limit]
    elif limit == COUNT_NOISE:
        assert flags.max_count_noise is not None  # or there was no such limit
        flag, bound = "--max-count-noise", flags.max_count_noise
    else:
        flag = {RATIO: "--max-error-ratio", "peak_sensitivity": "--max-sensitivity"}.get(limit)
    return "" if flag is None else f"{flag} {_up(bound * np.exp(violation))}"


def _up(value: float) -> str:
    """Three digits, none less than the value."""
    place = 10.0 ** (2 - np.floor(np.log10(value)))
    return f"{np.ceil(value * place * (1 - 1e-12)) / place:.6g}"


def hardly_worse(seen: Evidence) -> list[str]:
    """A line of contours that became worse by no more than the encoders can tell."""
    ratios = {
        one.name: ratio
        for one in seen.contours
        if (ratio := _ratio(one, seen)) > WORSE and _increase(one, seen) <= seen.finest
    }
    if not ratios:
        return []
    return [
        f"worse than the {seen.compared} by less than the rounding of the encoders, "
        f"{1e6 * seen.finest:.2g} um: {_named(ratios)}"
    ]


def active_limits(prices: Sequence[Price], bounds: Mapping[str, float]) -> list[ActiveLimit]:
    """Limits that stop further improvement, the dearest first.

    Entries of one limit, for different contours and plants, are loosened together.
    """
    totals = {name: sum(one.price for one in prices if one.name == name) for name in bounds}
    dear = sorted((name for name in totals if totals[name] > CHEAP), key=lambda n: -totals[n])
    return [ActiveLimit(name=name, bound=bounds[name], price=totals[name]) for name in dear]


def _unstable(
    contours: Sequence[TunedContour], margins: PathMargins, robust: RobustTest | None
) -> list[str]:
    lines = []
    lost = [one.name for one in contours if one.metrics["tuned"].worst.diverged]
    if lost:
        lines.append(
            f"a plant of the family diverges on {', '.join(lost)}: ask for more margin, "
            f"{_more_margin(margins)}"
        )
    if not margins.stable:
        lines.append(
            "with its gains frozen at a point of the training paths the loop is open or unstable: "
            "keep a margin, --max-sensitivity 2"
        )
    if robust is not None and robust.diverged:
        lines.append(
            f"{robust.diverged} of {robust.members} random plants of the family diverge: ask for "
            f"more margin, {_more_margin(margins)}"
        )
    return lines


def _more_margin(margins: PathMargins) -> str:
    """The flag that asks for more margin than there is."""
    there = np.inf if margins.sensitivity is None else margins.sensitivity
    return f"--max-sensitivity {max(1.1, min(1.7, round(0.85 * there, 1))):g}"


def may_drift(margins: PathMargins, contours: Sequence[TunedContour]) -> bool:
    """Whether something in the frozen loops lasts longer than any path: the tool, or not."""
    slow = (1 - margins.spectral_radius) * SLOWEST * _longest(contours) <= 1
    return margins.stable and slow


def _adrift(lasting: float, contours: Sequence[TunedContour]) -> list[str]:
    """A loop whose feedback does next to nothing: stable by a hair, and the tool drifts."""
    longest = _longest(contours)
    if lasting < SLOWEST * longest:
        return []
    took = f"takes {lasting:.2g} samples to come back" if np.isfinite(lasting) else "stays there"
    return [
        f"the feedback does next to nothing: a tool off its path {took}, the longest contour has "
        f"{longest} samples: begin at larger gains (--weights)"
    ]


def _longest(contours: Sequence[TunedContour]) -> int:
    return max(one.samples for one in contours)


def _late(margins: PathMargins, delay: int) -> list[str]:
    if not margins.stable or margins.delay_samples >= delay:
        return []
    return [
        f"the nominal loop bears {margins.delay_samples} samples of delay at a point of the "
        f"training paths, {delay} are asked for: keep a margin, --max-sensitivity 2"
    ]


def _infeasible(tuned: Tuned, limit: str, allowing: str) -> list[str]:
    if tuned.feasible:
        return []
    excess = 100 * np.expm1(tuned.violation)
    name = limit.removesuffix("_use").replace("_", " ")
    what = f"no weights were found within every limit; these exceed that on the {name}"
    return [f"{what} by {excess:.3g} %", *_what_helps(limit, allowing)]


def _what_helps(limit: str, allowing: str) -> list[str]:
    """What may be done about a limit that no weights keep."""
    if limit in USE_LIMITS:
        words = limit.removesuffix("_use")
        return [
            f"the motion asks for more {ASKED.get(words, words)} than the machine has; {TRY_LESS}"
        ]
    if limit == LATE:
        return ["a loop does not bear the delay that --min-delay-margin asks for; ask for less"]
    if limit == COUNT_NOISE:
        return [
            "the rounding of the encoders moves the control more than that; "
            f"{allowing} allows these weights, finer encoders need less"
        ]
    if not allowing:
        return []
    if limit == "peak_sensitivity":
        return [f"less margin allows these weights: {allowing}"]
    if limit == RATIO:
        return [f"a training contour stays worse than was asked for; {allowing} allows it"]
    return [f"lower the feed, or allow these weights: {allowing}"]


def _unknown(place: LeastKnown | None) -> list[str]:
    """A loop that rests on a response that is not known, and the record that shows it."""
    if place is None:
        return []
    off = f"{100 * place.relative:.3g} %" if place.relative < 2 else f"{place.relative:.3g} times"
    return [
        f"at {place.hertz:.3g} Hz the machine may answer {off} off its model, and the "
        f"complementary sensitivity there is {place.complementary:.2g}: at most "
        f"{BORNE / place.relative:.2g} is safe; record what shows the response there: "
        "jcontour identify --excite"
    ]


def _help_with(limits: Sequence[LimitCheck], feed_law: str) -> list[str]:
    """What helps where limits are not kept."""
    beyond = [one for one in limits if not one.kept]
    lines = []
    if any(one.name.startswith(OF_AXES) for one in beyond):
        lower = (
            "a motion that asks for less keeps the limit, and so may tuning on that contour as "
            f"well; {TRY_LESS}"
        )
        other = "; or with a toolpath file --feed-law jerk"
        lines.append(lower if feed_law == "jerk" else lower + other)
    if any("encoder counts" in one.name for one in beyond):
        lines.append("less --max-count-noise makes the control calmer, finer encoders as well")
    return lines


def _worse(seen: Evidence) -> list[str]:
    """Contours that the tuned weights make worse, those that were held out first."""
    lines = []
    for training, words in ((False, "held-out"), (True, "training")):
        ratios = {
            one.name: ratio
            for one in seen.contours
            if one.training is training
            and (ratio := _ratio(one, seen)) > WORSE
            and _increase(one, seen) > seen.finest
        }
        if ratios:
            lines.append(
                f"worse than the {seen.compared} on {words} contours: {_named(ratios)}; train on "
                "contours like them, or so that none pays for the others, --max-error-ratio 1 or "
                "--objective regret"
            )
    ratios = [ratio for one in seen.contours if (ratio := _ratio(one, seen)) > 0]
    typical = float(np.exp(np.mean(np.log(ratios)))) if ratios else 0.0
    if typical > WORSE and not lines:
        lines.append(
            f"worse than the {seen.compared} in all: the geometric mean of the worst errors of all "
            f"contours is x {typical:.2f}; keep the {seen.compared}"
        )
    return lines


def _restless(seen: Evidence) -> list[str]:
    """Weights that gain less than the encoders can tell, and make the control restless."""
    if not seen.compared:
        return []
    worst = [(one.metrics[seen.compared].worst, one.metrics[TUNED].worst) for one in seen.contours]
    if any(metrics.diverged for pair in worst for metrics in pair):
        return []
    start, tuned = max(worst, key=lambda pair: _times(*pair))
    times = _times(start, tuned)
    if times < RESTLESS or any(-_increase(one, seen) > seen.finest for one in seen.contours):
        return []
    return [
        "no contour becomes better by more than the rounding of the encoders, "
        f"{1e6 * seen.finest:.2g} um, and the control changes up to {times:.2g} times as much from "
        f"sample to sample: keep the {seen.compared}, or limit that change, "
        f"--max-rms-increment {2 * start.rms_increment:.2g}"
    ]


def _times(start: RunMetrics, tuned: RunMetrics) -> float:
    """Change of the control from sample to sample, tuned over start; 0 where it stands still."""
    return tuned.rms_increment / start.rms_increment if start.rms_increment else 0.0


def _named(ratios: Mapping[str, float]) -> str:
    return ", ".join(f"{name} x {ratio:.2f}" for name, ratio in ratios.items())


def _increase(contour: TunedContour, seen: Evidence) -> float:
    """Growth of the family's worst error [m]; none without a loop to compare with."""
    if not seen.compared:
        return 0.0
    before, after = (contour.metrics[name].worst for name in (seen.compared, TUNED))
    return rms_error(after, seen.error) - rms_error(before, seen.error)


def _ratio(contour: TunedContour, seen: Evidence) -> float:
    """Worst error of the family over that of the loop it is compared with.

    0 where one of them diverges, and without a loop to compare with.
    """
    if not seen.compared:
        return 0.0
    before, after = (contour.metrics[name].worst for name in (seen.compared, TUNED))
    if before.diverged or after.diverged:
        return 0.0
    return rms_error(after, seen.error) / rms_error(before, seen.error)


def run_warnings(
    run: TuningRun, tuned: Tuned, margins: PathMargins, replays: dict[str, Replay]
) -> list[str]:
    """All warnings, one line each; `replays` are those of start and tuned weights."""
    found = replays["tuned"]
    lines = search_warnings(tuned)
    if tuned.stabilised:
        lines += [f"with the start, {line}" for line in lost_at_start(run)]
    if run.design.learns:
        lines.append(
            "the controller learns while it runs: its margins are those of the loop that it begins "
            "with"
        )
    lines += run.machine.remarks
    lines += margin_warnings(margins, run.machine.unknown_delay, run.flags.min_delay_margin)
    longest = max(job.samples for job in run.scenarios.jobs)
    lines += slow_warnings(margins, longest, run.machine.model.dt)
    lines += limits_exceeded_by_plan(run.scenarios, run.machine)
    lines += swing_warnings(found, run.scenarios, run.machine)
    lines += arrival_warnings(found, run.scenarios)
    lines += drives_at_limits_in_rapids(found, run.scenarios, run.machine)
    if run.machine.error == "contour":  # the tracking error itself is tuned and shown otherwise
        lines += lag_warnings(replays, run.scenarios)
    return lines


def search_warnings(tuned: Tuned) -> list[str]:
    """Points that the tuner did not find, or had to reject."""
    lines = []
    if tuned.stabilised:
        lines.append("the start was unstable: the tuner first made every loop stable")
    if not tuned.stationary:
        lines.append(
            "the search ended before the gain that it sees was used up: --steps 60, or "
            "--every-start, may find better weights"
        )
    if tuned.diverged_points:
        points = f"{tuned.diverged_points} of {len(tuned.history)} evaluated points"
        lines.append(f"{points} had a diverging plant and were rejected")
    if tuned.diverged_starts:
        lines.append(
            f"{tuned.diverged_starts} descents could not begin because their start diverges"
        )
    return lines


def idle_warnings(names: Sequence[str]) -> list[str]:
    """Weights without any effect on the runs."""
    if not names:
        return []
    have, are = ("has", "is") if len(names) == 1 else ("have", "are")
    return [
        f"{', '.join(names)} {have} no effect on these runs and {are} left at the start: does the "
        "controller read it?"
    ]


def margin_warnings(margins: PathMargins, unknown_delay: int, asked: int = 0) -> list[str]:
    """Loops that are open or unstable, or that a little more delay makes unstable.

    Args:
        margins: of the tuned loops.
        unknown_delay: that the machine may have [samples].
        asked: delay margin that the flags ask for [samples]: losing it is a reason, no warning.
    """
    lines = []
    if margins.contours_without_margins:
        where = f"every probed point of {', '.join(margins.contours_without_margins)}"
        lines.append(f"there are no margins: at {where} {OPEN}")
    elif margins.spectral_radius >= 1:
        lines.append("with its gains frozen at a point of the training paths the loop is unstable")
    elif margins.delay_samples < unknown_delay:
        late = f"{margins.delay_samples + 1} sample{'s' if margins.delay_samples else ''} late"
        lines.append(
            f"{late}, as this machine may be, the loop frozen at a point of the training paths is "
            "unstable: longer runs may ring"
        )
    elif margins.delay_samples == 0 and not asked:
        lines.append(
            "one more sample of delay makes the loop unstable: --min-delay-margin 1 keeps it from "
            "that"
        )
    if margins.probes_left_out:
        points = (
            f"{margins.probes_left_out} probed point{'s' if margins.probes_left_out > 1 else ''}"
        )
        lines.append(f"margins leave out {points} where {OPEN}")
    return lines


def slow_warnings(margins: PathMargins, longest: int, dt: float) -> list[str]:
    """A mode of the loop that lasts longer than any run: no run shows what it does.

    It may be that of an observer that finds a load, or of an integral part, as well as the tool's.

    Args:
        margins: of the tuned loops.
        longest: samples of the longest contour.
        dt: sample period [s].
    """
    if not (margins.stable and margins.spectral_radius > np.exp(-1 / longest)):
        return []
    lasts = -1 / np.log(margins.spectral_radius)
    return [
        f"the slowest mode of the loop dies out to a third in {lasts:.4g} samples "
        f"({1e3 * dt * lasts:.3g} ms), the longest contour has {longest}: what a constant load "
        "does may last longer than these runs show; a longer part shows it"
    ]


def lag_warnings(replays: dict[str, Replay], scenarios: Scenarios) -> list[str]:
    """Tell where the tuned tool lags far more than before.

    Contour error alone is also small for a tool that hardly moves.
    """
    before = 1e6 * np.asarray(replays["start"].metrics.rms_tracking_error).max(axis=1)
    after = 1e6 * np.asarray(replays["tuned"].metrics.rms_tracking_error).max(axis=1)
    worst = int(np.argmax(after / before))
    if after[worst] < MUCH_LAG * before[worst]:
        return []
    lag = f"{after[worst]:.4g} um behind on {scenarios.jobs[worst].name}"
    return [
        f"the tool lags {lag} (start: {before[worst]:.4g} um): contour error alone does not mind; "
        "limit it with --max-tracking-error-um"
    ]
