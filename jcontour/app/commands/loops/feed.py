"""`jcontour feed`: contour error against cycle time of one part, under one controller."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from rich.console import Console

from jcontour.app.catalogue.choices import design_for, job_named, seeing_all
from jcontour.app.files.results.loop_results import FeedPoint, FeedResult
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.verdict import LimitCheck, Message, Verdict, exceeded
from jcontour.app.flags.loops import Feed
from jcontour.app.jobs.job import Job
from jcontour.app.jobs.replays import Scenarios, replay
from jcontour.app.plain_numbers import WholePath
from jcontour.app.reports import tables
from jcontour.app.reports.figures.loops import feeds_figure
from jcontour.app.reports.figures.png import save_figure
from jcontour.app.reports.progress import counted
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.checks.machine_limits import machine_limits
from jcontour.app.runs.checks.run_checks import limits_exceeded_by_plan, motions_not_followed
from jcontour.app.runs.contour_summary import cycle_time, family_metrics, machine_summary
from jcontour.app.runs.lifecycle import created, finished
from jcontour.app.runs.stored_loops import StoredLoop, loop_named

PAYS = 0.5  # of a rise of the feed, that has to come off the cycle time
SLOWEST, QUICKEST = 1.0, 1000.0  # per cent
MOST_SHOWN = 6  # feeds on the screen, the quickest ones


def feed_points(loop: StoredLoop, flags: Feed) -> Iterator[FeedPoint]:
    """Every feed, from the slowest to the quickest; the motion is planned anew for each.

    All runs are as long as that of the slowest feed, with samples that do not count behind their
    ends: to compile a program for each length would take more time than they do. A preview that is
    the whole path has other samples at every feed.

    Args:
        loop: of the flags; its first part is run.
        flags: with the feeds, in per cent of the programmed ones.

    Raises:
        ValueError: a feed that the machine's samples cannot hold.
    """
    longest = 0
    for override in sorted(set(flags.overrides)):
        pace = loop.pace._replace(override=override / 100)
        # with the pace of the loop it is planned already
        job = loop.jobs[0] if pace == loop.pace else job_named(loop.parts[0], pace)
        planned = job.planned if isinstance(job, Job) else None
        controller = loop.controller
        if isinstance(flags.preview, WholePath):
            design = design_for(loop.machine, seeing_all(flags, job))
            controller = design.build(design.start)
        scenarios = Scenarios.of(
            [job], [False], loop.machine, loop.fed, controller.preview, longest
        )
        if controller is loop.controller:
            longest = scenarios.references.steps
        found = replay(controller, scenarios)
        lost = np.asarray(found.metrics.diverged)[0]
        yield FeedPoint(
            override=override,
            cycle_time=cycle_time(job, loop.machine.model.dt),
            metrics=family_metrics(found, 0),
            diverged=[name for name, gone in zip(scenarios.plants, lost, strict=True) if gone],
            limits=machine_limits(found, scenarios, loop.machine),
            deviation=0.0 if planned is None else planned.around.deviation,
            planned=limits_exceeded_by_plan(scenarios, loop.machine),
            not_followed=motions_not_followed(found, scenarios),
        )


def recommended(
    points: Sequence[FeedPoint], error: str, tolerance: float | None
) -> tuple[FeedPoint | None, str]:
    """The feed to run, and why.

    The quickest one within the tolerance. Without one, the last at which a rise of the feed still
    takes half as much off the cycle time, or adds no error: beyond it the machine only accelerates.
    Where every rise does, as at constant feed, the time tells no feed from another: only the
    machine's limits do.
    """
    sound = [point for point in points if point.sound]
    if not sound:
        return None, "at every feed a plant does not follow or a limit of the machine is exceeded"
    if tolerance is not None:
        # The quickest of the feeds within the tolerance [m], and why; None where none is
        within = [point for point in sound if point.metrics.worst.peak(error) <= tolerance]
        if within:
            best = min(within, key=lambda point: point.cycle_time)
            return best, f"the quickest of these within {1e6 * tolerance:g} um on every plant"
        least = min(point.metrics.worst.peak(error) for point in sound)
        words = f"no feed keeps it: the least largest error is {1e6 * least:.4g} um"
        blended = min(point.deviation for point in sound)
        if tolerance <= blended:
            words += f", and the corners are blended within {1e6 * blended:.4g} um"
        return None, words
    best = sound[0]
    for point in sound[1:]:
        rise, gain = point.override / best.override, best.cycle_time / point.cycle_time
        cost = point.metrics.worst.peak(error) / best.metrics.worst.peak(error) - 1
        if cost > 0 and np.log(gain) < PAYS * np.log(rise):
            words = f"{100 * (rise - 1):.0f} % more feed takes {100 * (1 - 1 / gain):.0f} % off"
            return best, f"beyond it {words} the cycle time, with {100 * cost:.0f} % more error"
        best = point
    if best is not points[-1]:
        return best, "the quickest of these that the machine follows within its limits"
    if len(points) == 1:
        return best, "the only one of these; --tolerance-um says what the part allows"
    if best.metrics.worst.peak(error) <= min(point.metrics.worst.peak(error) for point in sound):
        return best, "the quickest of these, and no slower one has less error"
    return None, (
        "each rise of the feed takes at least half as many per cent off the cycle time, or adds "
        "no error, so time alone names none: give --tolerance-um, the largest error that the "
        "part allows"
    )


def verdict_on(
    best: FeedPoint | None,
    reason: str,
    points: Sequence[FeedPoint],
    error: str,
    tolerance: float | None,
) -> Verdict:
    """Verdict on the feed that `recommended` names, or on there being none.

    Args:
        best: the feed; None where none is recommended.
        reason: for or against it.
        points: all feeds.
        error: the error that counts, "contour" or "tracking".
        tolerance: largest error that is allowed [m]; None where none is given.
    """
    if best is None:
        undecided = tolerance is None and any(point.sound for point in points)
        against = [] if undecided else [Message("reason", reason)]
        return Verdict.of([], against, passed=f"No feed is recommended: {reason}.")
    limits = list(best.limits)
    if tolerance is not None:
        limits.append(
            LimitCheck(
                name=f"peak {error} error",
                value=1e6 * best.metrics.worst.peak(error),
                allowed=1e6 * tolerance,
                unit="um",
                member="family",
            )
        )
    return Verdict.of(limits, passed=f"USE {best.override:g} % of the feed: {reason}.")


def command(flags: Feed) -> int:
    """The whole command; exit code."""
    _check(flags)
    # The loop of a run folder, or of the flags
    loop = loop_named(flags, flags.part)
    if loop.machine.error == "tracking":
        raise ValueError(f"feed: {loop.machine.name} has one axis; its moves have no feed")
    points, count = [], len(set(flags.overrides))
    with counted(tables.console_of(stderr=True, quiet=flags.json), count, "feeds") as done:
        for point in feed_points(loop, flags):
            points.append(point)
            done(1)
    tolerance = None if flags.tolerance_um is None else 1e-6 * flags.tolerance_um
    best, reason = recommended(points, loop.machine.error, tolerance)
    result = FeedResult(
        machine=machine_summary(loop.machine),
        controller=loop.name,
        contour=loop.jobs[0].name,
        error=loop.machine.error,
        tolerance=tolerance,
        points=points,
        recommended=None if best is None else best.override,
        verdict=verdict_on(best, reason, points, loop.machine.error, tolerance),
        tuned=loop.tuned,
    )
    folder = created(flags, "feed")
    save_figure(feeds_figure(result), folder / "feed.png")
    write_result(folder, result)
    answer = [*feed_entries(result), *next_steps(result)]
    return finished(folder, result, flags, show, answer, result.verdict)


def _check(flags: Feed) -> None:
    if not flags.overrides:
        raise ValueError("overrides: needs at least one feed")
    for one in flags.overrides:
        if not SLOWEST <= one <= QUICKEST:
            raise ValueError(
                f"overrides: a feed of {SLOWEST:g} to {QUICKEST:g} % is needed, received {one:g}"
            )
    if flags.tolerance_um is not None and not flags.tolerance_um > 0:
        raise ValueError(f"tolerance-um: needs to be above zero, received {flags.tolerance_um}")


def show(result: FeedResult, console: Console) -> None:
    """The table, and what is wrong with a feed."""
    title = f"{result.contour} on {result.machine.name}, {result.controller}"

    def state(point: FeedPoint) -> str:
        if point.sound:
            return "recommended" if point.override == result.recommended else ""
        stays = "DOES NOT FOLLOW" if point.not_followed else "EXCEEDS"
        return "DIVERGES" if point.diverged else stays

    columns: dict[str, Callable[[FeedPoint], str | float]] = {
        "feed\n%": lambda point: f"{point.override:g}",
        "cycle\ntime s": lambda point: f"{point.cycle_time:.3f}",
        "peak um\nworst": lambda point: 1e6 * point.metrics.worst.peak(result.error),
        "RMS um\nworst": lambda point: 1e6 * point.metrics.worst.rms(result.error),
        "RMS um\nnominal": lambda point: 1e6 * point.metrics.nominal.rms(result.error),
        "peak\ncontrol": lambda point: point.metrics.worst.peak_control,
        "": state,
    }
    console.print(tables.table_of(title, result.points, columns, text_columns=0))
    for point in result.points:
        for line in [*point.not_followed, *exceeded(point.limits)]:
            tables.say(console, f"{point.override:g} %: {line}")
        if point.diverged:
            tables.say(console, f"{point.override:g} %: DIVERGES on {', '.join(point.diverged)}")
    beyond = [point for point in result.points if point.planned]
    feeds = ", ".join(f"{point.override:g}" for point in beyond)
    last = f" (numbers of {beyond[-1].override:g} %)" if len(beyond) > 1 else ""
    for line in beyond[-1].planned if beyond else ():  # numbers of the quickest one
        tables.say(console, f"WARNING: {feeds} %{last}: {line}")


def feed_entries(result: FeedResult) -> list[Entry]:
    """Every feed in a line: its cycle time and its largest error, and whether it is sound."""

    def words(point: FeedPoint) -> str:
        if not point.sound:
            return "DIVERGES" if point.diverged else "a limit is exceeded, or not followed"
        peak = 1e6 * point.metrics.worst.peak(result.error)
        return f"peak {result.error} error {tables.digits(peak)} um on the worst plant"

    entries = []
    for point in result.points[-MOST_SHOWN:]:
        feed = f"{point.override:g} %"
        entries.append(Entry(feed, f"{point.cycle_time:.3f} s, {words(point)}"))
        found = [*point.not_followed, *exceeded(point.limits), *point.planned]
        entries += [Entry("Warning", f"{feed}: {line}") for line in found]
    return entries


def next_steps(result: FeedResult) -> list[Entry]:
    """What to do after the table."""
    if result.recommended is None:
        return [Entry("Next", _next_try(result))]
    tune = "" if result.tuned else "; tune first where the controller is not tuned for it"
    words = f"set the feed override of the control, or the feeds of the program{tune}"
    return [Entry("Next", words)]


def _next_try(result: FeedResult) -> str:
    """What may bring a feed that can be recommended."""
    if result.tolerance is not None and result.corners_decide:
        closer = 1e6 * result.tolerance / 2
        return (
            f"--corner-tolerance-um {closer:.3g}, half of the tolerance, or less: at any "
            "feed the motion itself leaves the part. A run folder keeps its own; make another."
        )
    if result.undecided:
        return (
            "--tolerance-um; a part from rest to rest may also take quicker --overrides, up "
            "to where the machine mostly accelerates."
        )
    if all(point.planned and not point.sound for point in result.points):
        return "a motion that keeps the limits of the machine, as the warning says."
    if result.tuned:
        return "slower --overrides; the loop is a tuned one already."
    return "slower --overrides, or `jcontour tune` for this part and machine first."
