"""Tables that `jcontour tune` prints."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from experiments.files.tuned_result import (
    EngineRow,
    GapRow,
    LostFirst,
    PathMargins,
    TunedContour,
    TunedResult,
    rms_error,
)
from experiments.reports.tables import (
    columns_of,
    metric_cells,
    peak_line,
    plain_table,
    position,
    say,
)

SEEN = "Training contours"
HELD_OUT = "Held-out contours (never seen by the tuner)"


def show_tuned(result: TunedResult, console: Console) -> None:
    """Everything a tuning run found, and one sentence."""
    for table in design_tables(result):
        console.print(table)
    lines = [*peak_lines(result), *values_block(result), "", sentence(result)]
    say(console, *lines, *held_out_lines(result))


def design_tables(result: TunedResult) -> list[Table]:
    """Start against tuned, training and held-out contours apart, nominal plant and worst."""
    headings = [heading for _, heading, _ in columns_of(result.error)]
    columns = ["contour", "plant", "weights", *headings]
    made = []
    for training, title in ((True, SEEN), (False, HELD_OUT)):
        contours = [one for one in result.contours if one.training is training]
        rows = [row for one in contours for row in _contour_rows(one, result.error)]
        if rows:
            title = f"{title}, machine with {result.machine.nonsmooth_effects}"
            made.append(plain_table(title, columns, rows, text_columns=3))
    return made


def _contour_rows(contour: TunedContour, error: str) -> list[list[str]]:
    rows = []
    for plant in ("nominal", "worst"):
        words = plant
        for design, metrics in contour.metrics.items():
            name = "" if rows else contour.name
            rows.append([name, words, design, *metric_cells(getattr(metrics, plant), error)])
            words = ""
    return rows


def peak_lines(result: TunedResult) -> list[str]:
    """Where the tuned weights leave the largest error on every contour."""
    axes = result.machine.axes
    return [
        f"{one.name}, tuned: {peak_line(one.peak, result.error, axes)}"
        for one in result.contours
        if one.peak is not None
    ]


def values_block(result: TunedResult) -> list[str]:
    """The block "use these values"."""
    margins = result.margins
    probes = f"up to {margins.probes_per_contour} points of each training contour"
    lines = [
        "",
        "USE THESE VALUES" if result.usable else "DO NOT USE THESE VALUES: see the warnings",
        *(f"  {line}" for line in result.weight_lines),
        f"Stability margins of the loop, its gains frozen at {probes}",
    ]
    for name, value, before in margin_rows(margins, result.start_margins):
        lines.append(f"  {name:<23}  {value:<24} start: {before}")
    if margins.lost_first is not None:
        lines.append(lost_first_line(margins.lost_first, result.machine.axes))
    effects = result.machine.nonsmooth_effects
    lines.append(f"Gap of the machine with {effects} to the smooth one that was tuned")
    lines += [_gap_line(row) for row in result.gap]
    if result.confirmed:
        lines.append(f"The same runs in {result.confirmed[0].engine}, nominal plant")
        lines += [_engine_line(row) for row in result.confirmed]
    return [*lines, *(f"WARNING: {line}" for line in result.warnings)]


def sentence(result: TunedResult) -> str:
    """Worst RMS error of the training contours, before and after."""
    trained = [one.metrics for one in result.contours if one.training]
    worst = {}
    for design in ("start", "tuned"):
        errors = [rms_error(metrics[design].worst, result.error) for metrics in trained]
        worst[design] = max(errors)
    lost = any(metrics["start"].worst.diverged for metrics in trained)
    before = "diverged" if lost else f"{1e6 * worst['start']:.4g} um"
    after = f"{1e6 * worst['tuned']:.4g} um"
    if any(metrics["tuned"].worst.diverged for metrics in trained):
        after = "diverged"
    what = f"Worst RMS {result.error} error over training contours and plants"
    return f"{what}: {before} with the start weights, {after} with the tuned ones."


def held_out_lines(result: TunedResult) -> list[str]:
    """Which held-out contours the tuned weights make worse; no line where they make none worse."""
    held_out = [one for one in result.contours if not one.training]
    ratios = {}
    for one in held_out:
        start, tuned = (
            rms_error(one.metrics[design].worst, result.error) for design in ("start", "tuned")
        )
        if tuned > start:
            ratios[one.name] = tuned / start
    if not ratios:
        return []
    worse = ", ".join(f"{name} x {ratio:.2f}" for name, ratio in ratios.items())
    count = f"{len(ratios)} of {len(held_out)}"
    return [f"WARNING: worse than the start weights on {count} held-out contours: {worse}"]


def _engine_line(row: EngineRow) -> str:
    errors = f"{1e6 * row.ours:.6g} -> {1e6 * row.theirs:.6g} um RMS"
    return f"  {row.contour:<23} {errors}, tools at most {1e6 * row.apart:.2g} um apart"


def _gap_line(row: GapRow) -> str:
    where = f"  {row.contour}, {row.plant}"
    if row.relative - row.relative != 0:  # NaN or infinite
        return f"{where}: diverged"
    errors = f"{1e6 * row.smooth:.5g} -> {1e6 * row.nonsmooth:.5g} um RMS"
    return f"{where:<25} {errors} ({100 * row.relative:+.2f} %)"


def margin_rows(*designs: PathMargins) -> list[tuple[str, ...]]:
    """One row per margin: its name, then its value for every design."""
    radii = (f"{one.spectral_radius:.6f} (stable < 1)" for one in designs)
    rows = [("largest spectral radius", *radii)]
    for k in range(len(designs[0].gain_range)):
        rows.append((f"gain margin, input {k + 1}", *(_gain_range(one, k) for one in designs)))
    return [*rows, ("delay margin", *(_delay(one) for one in designs))]


def lost_first_line(place: LostFirst, axes: Sequence[str]) -> str:
    """Where the loop is lost first."""
    where = f"on {place.contour} where the reference is at {position(axes, place.position)}"
    return f"  {'stability lost first':<23}  input {place.input}, {where}"


def _gain_range(margins: PathMargins, k: int) -> str:
    (low, high), (least, most) = margins.gain_range[k], margins.gain_search
    below = f"{least:.4g} or less" if low <= least else f"{low:.4g}"
    above = f"{most:.4g} or more" if high >= most else f"{high:.4g}"
    return f"x {below} ... {above}"


def _delay(margins: PathMargins) -> str:
    found = margins.delay_samples
    if found < 0:
        return "none: unstable as it is"
    more = " or more" if found >= margins.delay_search else ""
    return f"{found}{more} extra samples"
