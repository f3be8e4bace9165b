"""Tables and entries of the screen that `jcontour simulate` prints."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.results.run_metrics import METRICS, MotionSummary
from jcontour.app.reports.screen import Entry, read_notes
from jcontour.app.reports.tables import (
    columns_of,
    digits,
    metric_cells,
    peak_line,
    plain_table,
    read_line,
    say,
)

TOLD = 0.01  # of the cycle time, that the planner may leave to gain without a word


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
    if result.peak is not None:
        line = peak_line(result.peak, result.error, result.machine.axes)
        say(console, f"{line[0].upper()}{line[1:]}.")
    else:
        say(console, "")


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
    if left > TOLD:
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
            f"{of_all if len(runs) > 1 else ''}",
        )
    ]
    if result.peak is not None:
        entries.append(Entry("Worst", peak_line(result.peak, result.error, result.machine.axes)))
    peak, unit = max(one.peak_control for one in runs), result.machine.control_unit
    entries.append(Entry("Effort", f"peak control {digits(peak)} {unit}"))
    if result.motion is not None:
        motion = result.motion
        limit = max(motion.shares, key=lambda name: motion.shares[name])
        share = f"{100 * motion.shares[limit]:.0f} % of it at the limit of {limit}"
        entries.append(Entry("Time", f"{motion.cycle_time:.3f} s, {share}"))
    elif result.read is not None and result.read.duration is not None:
        entries.append(Entry("Time", f"{result.read.duration:.3f} s"))
    return [*entries, *notes]
