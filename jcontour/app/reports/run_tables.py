"""Tables and screens of `jcontour tune` and `jcontour simulate`."""

import math
from collections.abc import Iterator, Mapping, Sequence

from rich.console import Console
from rich.table import Table

from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.results.run_metrics import METRICS, MotionSummary
from jcontour.app.files.results.tuned_result import (
    DriveLoop,
    PathMargins,
    TunedResult,
)
from jcontour.app.reports.screen import INDENT, WIDTH, Entry, read_notes
from jcontour.app.reports.tables import (
    columns_of,
    digits,
    metric_cells,
    peak_line,
    place_words,
    plain_table,
    position,
    read_line,
    say,
    scored_words,
)

SEEN, HELD_OUT = "training", "held out"
LOOSE = 20  # columns that breaking between words may leave empty
STEP = 1.1  # of a limit, whose worth is shown
EFFORT = ("peak_{error}_error", "rms_tracking_error", "rms_control", "rms_increment")


def show_tuned(result: TunedResult, console: Console) -> None:
    """Everything a tuning run found, and one sentence."""
    rms, effects = f"rms_{result.error}_error", result.machine.nonsmooth_effects
    title = f"RMS {result.error} error in um, machine with {effects}"
    errors = {plant: (plant, rms) for plant in ("nominal", "worst")}
    console.print(_compared_table(result, title, errors, change=True))
    title = f"What it costs, worst of the family; controls in {result.machine.control_unit}"
    names = [name.replace("{error}", result.error) for name in EFFORT]
    efforts = {METRICS[name].heading: ("worst", name) for name in names if name != rms}
    console.print(_compared_table(result, title, efforts))
    say(
        console,
        *(  # where the tuned weights leave the largest error
            f"{one.name}, tuned: {peak_line(one.peak, result.error, result.machine.axes)}"
            for one in result.contours
            if one.peak is not None and one.shown
        ),
        "",
        f"{result.controller}, tuned",
        *(f"  {line}" for line in result.weight_lines),
        *margin_lines(result),
        *trial_lines(result),
        *(f"What stops it: {line}." for line in limit_lines(result)),
    )


def tuned_answer(result: TunedResult, run: str = "RUN") -> list[Entry]:
    """What changes, where the worst is, what it costs, the margins, the limit and the drive.

    `run` is the folder in commands.
    """
    if not result.contours:
        return []
    changes = [change_words(result, True), change_words(result, False)]
    against = f"{result.contours[0].compared} -> tuned"
    compared = f"RMS {result.error}, worst case, {against}"
    entries = [Entry("Error", f"{compared}: {'; '.join(filter(None, changes))}")]
    places = []
    for training in (True, False):  # the user's parts before contours that are not his
        peaks = [(one.name, one.peak) for one in result.contours if one.training is training]
        known = [(name, peak) for name, peak in peaks if peak is not None]
        if known:
            name, peak = max(known, key=lambda pair: pair[1].error)
            size = f"{name} {digits(1e6 * peak.error)} um"
            where = f"{place_words(peak, result.machine.axes)} ({peak.plant})"
            places.append(f"{size} {where}" if training else f"held out {size}")
    if places:
        entries.append(Entry("Worst", f"largest {result.error} error: {'; '.join(places)}"))
    # Controls, and the margins of the tuned loops beside the peak sensitivity of the start
    sizes = []
    for name in ("rms_control", "rms_increment"):
        pairs = [(one.metrics[one.compared], one.metrics["tuned"]) for one in result.contours]
        largest = (
            max(getattr(run.worst, name) for run in runs) for runs in zip(*pairs, strict=True)
        )
        sizes.append(" -> ".join(map(digits, largest)))
    unit = result.machine.control_unit
    effort = f"RMS control {sizes[0]} {unit}, its change {sizes[1]}"
    margin, start = "none: a loop is open or unstable", result.start_margins.sensitivity
    if (tuned := result.margins).stable:
        low, high = zip(*tuned.gain_range, strict=True)
        before = "unstable" if start is None else digits(start)
        late = f"{tuned.delay_samples}{'+' * (tuned.delay_samples >= tuned.delay_search)}"
        gain = f"gain x {max(low):.2g} ... {min(high):.2g}"
        margin = f"Ms {digits(tuned.sensitivity)} (start {before}), {gain}, {late} samples of delay"
    return [
        *entries,
        Entry("Effort", effort),
        Entry("Margin", margin),
        Entry("Limit", "; ".join(limit_lines(result)[:1]) or "none is reached"),
        *([] if result.drive is None else [Entry("Drive", drive_words(result, result.drive, run))]),
        *(note for one in result.contours for note in read_notes(one.name, one.read)),
    ]


def change_words(result: TunedResult, training: bool) -> str:
    """Worst RMS error of the family from start, or baseline, to tuned, of one set of contours."""
    pairs = {}
    for one in result.contours:
        start, tuned = (one.metrics[name].worst for name in (one.compared, "tuned"))
        if one.training is training and not (start.diverged or tuned.diverged):
            pairs[one.name] = [1e6 * metrics.rms(result.error) for metrics in (start, tuned)]
    if not pairs:
        return ""
    before, after = map(max, zip(*pairs.values(), strict=True))
    ratios = [math.log(tuned / start) for start, tuned in pairs.values()]
    change = f"{100 * (math.exp(sum(ratios) / len(ratios)) - 1):+.0f} %"
    sizes = f"{digits(before)} -> {digits(after)} um"
    if len(pairs) == 1:
        return f"{next(iter(pairs))} {sizes} ({change})"
    words = "training" if training else "held-out"
    return f"{len(pairs)} {words} {sizes} (mean {change})"


def drive_words(result: TunedResult, drive: DriveLoop, run: str) -> str:
    """The simple loop, its error beside the tuned one's, and all of its gains.

    Gains that take more than two lines are those of a command.
    """
    from jcontour.app.reports.drives import drive_gains

    words = drive.controller
    if drive.controller != result.controller:
        beyond = "" if drive.kept else ", beyond a limit"
        words += f", {drive.error / drive.tuned_error:.2g} times the tuned error{beyond}"
    gains = ", ".join(drive_gains(drive.weights, result.machine.control_unit))
    if len(words) + len(gains) < 2 * (WIDTH - INDENT) - LOOSE:
        return f"{words}: {gains}"
    return f"{words}; its gains: jcontour report {run} --drive general --no-page"


def _compared_table(
    result: TunedResult,
    title: str,
    columns: Mapping[str, tuple[str, str]],
    change: bool = False,
) -> Table:
    """Start, or baseline, beside tuned weights on every contour: a plant's metric by heading."""
    designs = [result.contours[0].compared, "tuned", *(["change %"] if change else [])]
    rows = []
    for training, words in ((True, SEEN), (False, HELD_OUT)):
        contours = [one for one in result.contours if one.training is training]
        if contours:
            rows.append([words])
        shown = [one for one in contours if one.shown]
        for one in shown:
            rows.append([f"  {one.name}"])
            for plant, name in columns.values():
                runs = [getattr(one.metrics[each], plant) for each in (one.compared, "tuned")]
                before, after = (METRICS[name].factor * getattr(run, name) for run in runs)
                lost = [run.diverged for run in runs]
                for value, diverged in zip((before, after), lost, strict=True):
                    rows[-1].append("diverged" if diverged else digits(value))
                if change:
                    rows[-1].append("" if any(lost) else f"{100 * (after / before - 1):+.0f}")
        if len(shown) < len(contours):
            rows.append([f"  {len(contours) - len(shown)} fared better"])
    headings = [f"{words}\n{each}" for words in columns for each in designs]
    return plain_table(title, ["contour", *headings], rows)


def margin_lines(result: TunedResult) -> Iterator[str]:
    """Margins of the tuned loop beside those of the start, and where it is lost first."""
    probes = f"up to {result.margins.probes_per_contour} points of each training contour"
    yield f"Margins of the nominal loop, its gains frozen at {probes}"
    for name, value, before in margin_rows(result.margins, result.start_margins):
        yield f"  {name:<23}  {value:<24} start: {before}"
    if (place := result.margins.lost_first) is not None:
        where = position(result.machine.axes, place.position)
        yield (
            f"  {'stability lost first':<23}  input {place.input}, on {place.contour} where the "
            f"reference is at {where}"
        )


def trial_lines(result: TunedResult) -> Iterator[str]:
    """Other plants, and standstill."""
    error, unit = result.error, result.machine.control_unit
    if (test := result.robust) is not None:
        lost = "none diverges" if test.diverged == 0 else f"{test.diverged} DIVERGE"
        worst = f"{1e6 * test.error:.4g} um on {test.contour} ({test.plant})"
        drawn = "" if result.margins.uncertainty is None else "; none has another response"
        yield (
            f"{test.members} plants of the family, at its corners and at random: {lost}, "
            f"worst RMS {error} error {worst}{drawn}"
        )
    if {"start", "tuned"} <= set(result.standstill):
        start, tuned = result.standstill["start"], result.standstill["tuned"]
        control = f"{digits(start.rms_control)} -> {digits(tuned.rms_control)} {unit} RMS"
        increment = f"{digits(start.rms_increment)} -> {digits(tuned.rms_increment)} per sample"
        yield f"Standstill between two counts, worst of the family: control {control}, {increment}"


def limit_lines(result: TunedResult) -> list[str]:
    """Limits that stop further improvement, and what one more step of each would buy."""
    from tuning.objectives import LATE  # it loads the analysis of loops

    lines = []
    for one in result.active:
        words = limit_words(one.name, one.bound)
        if one.name == LATE:  # samples are whole: a tenth of one means nothing
            lines.append(words)
            continue
        gain = 100 * (1 - STEP**-one.price)
        more = f"{100 * (STEP - 1):.0f} % more of it would buy about {gain:.2g} % of error"
        lines.append(f"{words}; {more}")
    return lines


def limit_words(name: str, bound: float) -> str:
    """A limit of the tuner in words; `..._use` stands for a limit that the machine states."""
    from tuning.objectives import COUNT_NOISE, LATE, RATIO

    if name == LATE:
        return "delay margin of every plant"
    if name == RATIO:
        return f"error of every training contour <= {bound:.6g} of its start"
    if name == COUNT_NOISE:
        return f"rms control by encoder counts <= {bound:.6g}"
    if name.endswith("_use"):
        return f"{name.removesuffix('_use')} <= {100 * bound:.3g} % of the machine's limit"
    limited = name.replace("_", " ")
    if name.endswith("_error"):
        return f"{limited} <= {1e6 * bound:.6g} um"
    return f"{limited} <= {bound:.6g}"


def margin_rows(*designs: PathMargins) -> list[tuple[str, ...]]:
    """One row per margin: its name, then its value for every design."""
    radii = (f"{one.spectral_radius:.6f} (stable < 1)" for one in designs)
    rows = [("spectral radius, nominal", *radii)]
    for k in range(len(designs[0].gain_range)):
        cells = []
        for one in designs:
            (low, high), (least, most) = one.gain_range[k], one.gain_search
            below = f"{least:.4g} or less" if low <= least else f"{low:.4g}"
            above = f"{most:.4g} or more" if high >= most else f"{high:.4g}"
            cells.append(f"x {below} ... {above}")
        rows.append((f"gain margin, input {k + 1}", *cells))
    rows.append(("delay margin", *(_delay(one) for one in designs)))
    for name, words in (("sensitivity", "Ms"), ("complementary", "Mt")):
        values = [getattr(one, name) for one in designs]
        peaks = ("unstable" if value is None else f"{value:.4g}" for value in values)
        rows.append((f"{words} over the family", *peaks))
    if any(one.uncertainty is not None for one in designs):
        used = (
            "unstable" if one.uncertainty is None else f"{one.uncertainty:.3g} (stable < 1)"
            for one in designs
        )
        rows.append(("unknown response", *used))
    return rows


def _delay(margins: PathMargins) -> str:
    if margins.delay_samples < 0:
        return "none: unstable as it is"
    more = " or more" if margins.delay_samples >= margins.delay_search else ""
    return f"{margins.delay_samples}{more} extra samples"


TO_GAIN = 0.01  # of the cycle time, that the planner may leave to gain without a word


def show_simulated(result: SimulatedResult, console: Console) -> None:
    """The table, what was read, and one sentence."""
    # One row per plant of the family
    headings = [METRICS[name].heading for name in columns_of(result.error)]
    rows = [
        [plant, *metric_cells(metrics, result.error)] for plant, metrics in result.plants.items()
    ]
    run = f"{result.controller} on {result.contour}, {result.samples} samples"
    title = f"{run}, {result.feed_law}, {result.machine.nonsmooth_effects}"
    console.print(plain_table(title, ["plant", *headings], rows))
    if result.read is not None:
        say(console, f"Read {read_line(result.contour, result.read, result.machine.axes)}")
    if result.motion is not None:
        console.print(motion_table(result.motion, result.machine.axes))


def motion_table(motion: MotionSummary, axes: Sequence[str]) -> Table:
    """How long the motion takes, what limits it, and the peaks of every axis."""
    shares = [
        [
            "time at rest" if name == "rest" else f"time under the limit of {name}",
            f"{100 * share:.1f} %",
        ]
        for name, share in motion.shares.items()
        if share or name != "rest"
    ]
    peaks = [
        [f"peak jerk of {axis}", f"{digits(peak)} of {digits(limit)} m/s^3"]
        for axis, peak, limit in zip(axes, motion.peak_jerk, motion.jerk_limit, strict=True)
    ]
    rows = [
        ["cycle time", f"{motion.cycle_time:.3f} s"],
        *([["of it at rest", f"{motion.dwell:.3f} s"]] if motion.dwell else []),
        ["stops on the way", str(motion.stops)],
        ["corners blended within", f"{1e6 * motion.deviation:.3g} um"],
        *shares,
        *peaks,
    ]
    left = motion.gap / motion.cycle_time
    if left > TO_GAIN:
        rows.insert(1, ["NOT THE QUICKEST, by about", f"{100 * left:.1f} %"])
    return plain_table("Motion that the machine is asked for (motion.png)", ["", ""], rows)


def simulated_answer(result: SimulatedResult) -> list[Entry]:
    """Errors of the nominal plant and the worst, where the worst is, and the motion."""
    runs = [one for one in result.plants.values() if not one.diverged]
    notes = read_notes(result.contour, result.read)
    if not runs:
        return notes
    nominal, worst = next(iter(result.plants.values())), max(one.rms(result.error) for one in runs)
    sizes = [1e6 * one for one in (nominal.rms(result.error), worst)]
    of_all = f", worst of {len(result.plants)} plants {digits(sizes[1])} um"
    entries = [
        Entry(
            "Error",
            f"RMS {result.error} {digits(sizes[0])} um with {result.controller}"
            f"{of_all if len(runs) > 1 else ''}"
            f"{'' if result.read is None else scored_words(result.read)}",
        )
    ]
    if result.peak is not None:
        size = f"{digits(1e6 * result.peak.error)} um"
        place = place_words(result.peak, result.machine.axes)
        entries.append(Entry("Worst", f"{size} {place} ({result.peak.plant})"))
    if result.peak_controls:
        peaks = ", ".join(map(digits, result.peak_controls))
        of_each = " of the inputs" if len(result.peak_controls) > 1 else ""
        effort = f"peak control{of_each} {peaks} {result.machine.control_unit}, all samples"
        entries.append(Entry("Effort", effort))
    if result.motion is not None:
        motion = result.motion
        limit = max(motion.shares, key=lambda name: motion.shares[name])
        share = f"{100 * motion.shares[limit]:.0f} % of it at the limit of {limit}"
        entries.append(Entry("Time", f"{motion.cycle_time:.3f} s, {share}; {result.feed_law}"))
    elif result.read is not None and result.read.duration is not None:
        entries.append(Entry("Time", f"{result.read.duration:.3f} s; {result.feed_law}"))
    return [*entries, *notes]
