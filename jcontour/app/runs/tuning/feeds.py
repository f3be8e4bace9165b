"""Front of one part over the feed: cycle time against contour error, under one controller."""

from collections.abc import Iterator

import numpy as np

from jcontour.app.catalogue.choices import design_for, job_named, seeing_all
from jcontour.app.files.results.run_metrics import METRICS
from jcontour.app.files.results.search_results import BudgetPoint, FrontResult
from jcontour.app.files.results.verdict import LimitCheck, Verdict, exceeded, reason
from jcontour.app.flags.tuning import Front
from jcontour.app.jobs.job import Job
from jcontour.app.jobs.replays import Scenarios, replay
from jcontour.app.plain_numbers import WholePath
from jcontour.app.reports import tables
from jcontour.app.reports.progress import counted
from jcontour.app.runs.checks.machine_limits import machine_limits
from jcontour.app.runs.checks.run_checks import limits_exceeded_by_plan, motions_not_followed
from jcontour.app.runs.contour_summary import cycle_time, family_metrics, loop_summary
from jcontour.app.runs.stored_loops import StoredLoop, loop_named
from jcontour.app.runs.tuning.limits import named_limits

SLOWEST, QUICKEST = 1.0, 1000.0  # per cent
OF_SEARCH = (  # flags of a search, which feeds are not
    *("points", "least", "most", "free", "max_effort", "nominal_only", "objective"),
    *("max_sensitivity", "min_delay_margin", "max_count_noise", "resume"),
)


def front_of_feeds(flags: Front) -> FrontResult:
    """The part at every feed of the flags, from the slowest; limits of the flags hold at each."""
    _check(flags)
    limits = named_limits(flags)
    loop = loop_named(flags, flags.parts[0] if flags.parts else None)
    if loop.machine.error == "tracking":
        raise ValueError(f"against: {loop.machine.name} has one axis; its moves have no feed")
    points, count = [], len(set(flags.overrides))
    with counted(tables.console_of(stderr=True, quiet=flags.json), count, "feeds") as done:
        for point in _points(loop, flags, limits):
            points.append(point)
            done(1)
    within, best = [point for point in points if point.feasible], None
    if not within:
        least = min(points, key=lambda point: point.objective)
        why = [reason(f"{least.budget:g} %, of the least error: {m}") for m in least.messages]
        verdict = Verdict.of([], why, passed="USE A FEED OF THESE")
    elif not limits:
        words = "No feed is recommended: --max-peak-contour-error-um says what the part allows."
        verdict = Verdict.of([], passed=words)
    else:
        best = min(within, key=lambda point: point.cycle_time).budget
        words = f"USE {best:g} % of the feed: the quickest of these within every limit."
        verdict = Verdict.of([], passed=words)
    return FrontResult(
        **loop_summary(loop.machine, loop.name),
        weights=[],
        points=points,
        against="feed",
        contour=loop.jobs[0].name,
        recommended=best,
        verdict=verdict,
    )


def _check(flags: Front) -> None:
    usual = Front()
    for name in OF_SEARCH:
        if getattr(flags, name) != getattr(usual, name):
            flag = name.replace("_", "-")
            raise ValueError(f"{flag}: --against feed searches no weights; leave it out")
    if len(flags.parts) > 1:
        raise ValueError(f"parts: --against feed runs one part, received {len(flags.parts)}")
    if not flags.overrides:
        raise ValueError("overrides: needs at least one feed")
    for one in flags.overrides:
        if not SLOWEST <= one <= QUICKEST:
            raise ValueError(
                f"overrides: a feed of {SLOWEST:g} to {QUICKEST:g} % is needed, received {one:g}"
            )


def _points(loop: StoredLoop, flags: Front, limits: dict[str, float]) -> Iterator[BudgetPoint]:
    """Every feed, from the slowest to the quickest; the motion is planned anew for each.

    All runs are as long as that of the slowest feed, with samples that do not count behind their
    ends: to compile a program for each length would take more time than they do. A preview that is
    the whole path has other samples at every feed.
    """
    longest, error = 0, loop.machine.error
    for override in sorted(set(flags.overrides)):
        pace = loop.pace._replace(override=override / 100)
        # with the pace of the loop it is planned already
        job = loop.jobs[0] if pace == loop.pace else job_named(loop.parts[0], pace)
        controller = loop.controller
        if isinstance(flags.preview, WholePath):
            design = design_for(loop.machine, seeing_all(flags, job))
            controller = design.complete(design.start)
        scenarios = Scenarios.of(
            [job], [False], loop.machine, loop.fed, controller.preview, longest
        )
        if controller is loop.controller:
            longest = scenarios.references.steps
        runs = replay(controller, scenarios)
        worst = family_metrics(runs, 0).worst
        lost = np.asarray(runs.metrics.diverged)[0]
        checks = [
            *machine_limits(runs, scenarios, loop.machine),
            *(
                LimitCheck(
                    name=METRICS[name].words,
                    value=METRICS[name].factor * getattr(worst, name),
                    allowed=METRICS[name].factor * bound,
                    unit=METRICS[name].shown(loop.machine.control_unit),
                    member="family",
                )
                for name, bound in limits.items()
            ),
        ]
        against = [
            *(f"DIVERGES on {scenarios.plants[k]}" for k in np.flatnonzero(lost)),
            *motions_not_followed(runs, scenarios),
            *exceeded(checks),
        ]
        notes = limits_exceeded_by_plan(scenarios, loop.machine)
        planned = job.planned if isinstance(job, Job) else None
        if against and planned is not None and planned.around.deviation > 0:
            notes.append(
                f"corners are blended within {1e6 * planned.around.deviation:.3g} um of the part, "
                "at any feed: --corner-tolerance-um"
            )
        yield BudgetPoint(
            budget=override,
            weights={},
            rms_contour_error=worst.rms_contour_error,
            rms_tracking_error=worst.rms_tracking_error,
            rms_increment=worst.rms_increment,
            objective=worst.peak(error),
            feasible=not against,
            slack=False,
            peak_sensitivity=np.nan,
            cycle_time=cycle_time(job, loop.machine.model.dt),
            messages=[*against, *notes],
        )
