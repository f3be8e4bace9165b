"""`jcontour feed`: contour error against cycle time of one part, under one controller."""

from rich.console import Console

from jcontour.app.files.results.feed_result import FeedPoint, FeedResult
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.verdict import exceeded
from jcontour.app.flags.loops import Feed
from jcontour.app.reports import tables
from jcontour.app.reports.figures.loops.feeds import feeds_figure
from jcontour.app.reports.figures.shared.png import save_figure
from jcontour.app.runs.lifecycle import created, finished
from jcontour.app.runs.loops.feeds import feed_points, loop_at_feeds, recommended, verdict_on
from jcontour.app.runs.tuning.results import machine_summary

SLOWEST, QUICKEST = 1.0, 1000.0  # per cent
HEADINGS = (
    "feed\n%",
    "cycle\ntime s",
    "peak um\nworst",
    "RMS um\nworst",
    "RMS um\nnominal",
    "peak\ncontrol",
    "",
)


def command(flags: Feed) -> int:
    """The whole command; exit code."""
    _check(flags)
    loop = loop_at_feeds(flags)
    points, count = [], len(set(flags.overrides))
    with tables.console_of(quiet=flags.json).status("planning and running") as status:
        for point in feed_points(loop, flags):
            points.append(point)
            status.update(f"planning and running: {len(points)} of {count} feeds done")
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
    return finished(folder, result, flags, show, next_steps(result), result.verdict)


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
    rows = [_cells(point, result) for point in result.points]
    console.print(tables.plain_table(title, HEADINGS, rows, text_columns=0))
    for point in result.points:
        for line in [*point.not_followed, *exceeded(point.limits)]:
            tables.say(console, f"{point.override:g} %: {line}")
        if point.diverged:
            tables.say(console, f"{point.override:g} %: DIVERGES on {', '.join(point.diverged)}")
    tables.say(console, *_plan_warnings(result))


def _plan_warnings(result: FeedResult) -> list[str]:
    """What the motion itself exceeds, in numbers of the quickest feed at which it does."""
    beyond = [point for point in result.points if point.planned]
    if not beyond:
        return []
    feeds = ", ".join(f"{point.override:g}" for point in beyond)
    last = f" (numbers of {beyond[-1].override:g} %)" if len(beyond) > 1 else ""
    return [f"WARNING: {feeds} %{last}: {line}" for line in beyond[-1].planned]


def _cells(point: FeedPoint, result: FeedResult) -> list[str]:
    worst, nominal = point.metrics.worst, point.metrics.nominal
    sizes = [
        getattr(worst, f"peak_{result.error}_error"),
        getattr(worst, f"rms_{result.error}_error"),
        getattr(nominal, f"rms_{result.error}_error"),
    ]
    verdict = "recommended" if point.override == result.recommended else ""
    if not point.sound:
        stays = "DOES NOT FOLLOW" if point.not_followed else "EXCEEDS"
        verdict = "DIVERGES" if point.diverged else stays
    errors = [tables.digits(1e6 * size) for size in sizes]
    time = f"{point.cycle_time:.3f}"
    return [f"{point.override:g}", time, *errors, tables.digits(worst.peak_control), verdict]


def next_steps(result: FeedResult) -> list[str]:
    """What to do after the table."""
    if result.recommended is None:
        return [_next_try(result)]
    tune = (
        "" if result.tuned else " `jcontour tune` first where the controller is not tuned for it."
    )
    return [f"Next: set the feed override of the control, or the feeds of the program.{tune}"]


def _next_try(result: FeedResult) -> str:
    """What may bring a feed that can be recommended."""
    if result.tolerance is not None and result.corners_decide:
        closer = 1e6 * result.tolerance / 2
        return (
            f"Next: --corner-tolerance-um {closer:.3g}, half of the tolerance, or less: at any "
            "feed the motion itself leaves the part. A run folder keeps its own; make another."
        )
    if result.undecided:
        return (
            "Next: --tolerance-um; a part from rest to rest may also take quicker --overrides, up "
            "to where the machine mostly accelerates."
        )
    if all(point.planned and not point.sound for point in result.points):
        return "Next: a motion that keeps the limits of the machine, as the warning says."
    if result.tuned:
        return "Next: slower --overrides; the loop is a tuned one already."
    return "Next: slower --overrides, or `jcontour tune` for this part and machine first."
