"""Tables that `jcontour tolerance` prints."""

from rich.console import Console

from jcontour.app.files.results.tolerance_result import KeptRun, ToleranceResult
from jcontour.app.reports.tables import digits, of_axes, of_inputs, plain_table, read_line, say

HEADINGS = (
    "plant",
    "what acts",
    "largest\nerror um",
    "of the\ntolerance",
    "largest\ncontrols",
    "samples\nwithout answer",
    "left the bounds\nat sample",
)


def show_tolerance(result: ToleranceResult, console: Console) -> None:
    """What is promised and why it is not less, the runs, and a sentence."""
    if result.read is not None:
        say(console, f"Read {read_line(result.contour, result.read, result.machine.axes)}")
    least = sum(result.shares.values())
    sizes = {**result.shares, "the least that can be promised": least, "promised": result.promised}
    shares = [[name, f"{1e6 * size:.3f}"] for name, size in sizes.items()]
    title = f"Tolerance of {result.contour} on {result.machine.name}"
    console.print(plain_table(title, ["share", "um"], shares))
    say(console, *promise(result), "")
    title = f"Runs, {result.samples} samples, {result.feed_law}"
    rows = [_cells(run, result.promised) for run in result.runs]
    console.print(plain_table(title, HEADINGS, rows, text_columns=2))
    say(console, *findings(result))


def promise(result: ToleranceResult) -> list[str]:
    """What is promised, under which conditions, and what keeps it from being smaller."""
    unit = result.machine.control_unit
    limiting = ", ".join(result.limiting)
    why = f"the limits of {limiting}" if limiting else "the machine alone, none of its limits"
    most = of_inputs(dict(enumerate(result.control_limit)), unit)
    return [
        f"Proven for every force of up to {digits(result.force)} {unit} on each control and every "
        f"encoder error of up to {of_axes(result.encoder, result.machine.axes)}, at each sample,",
        f"on one plant, {result.plant}; no control above {most}. A disturbance is forgotten after "
        f"{result.length} samples. What decides: {why}.",
    ]


def findings(result: ToleranceResult) -> list[str]:
    """Whether it was kept, by whom, and what the others lack."""
    within = [run for run in result.runs if run.within]
    if not all(run.keeps(result.promised) for run in within):
        return []  # the verdict names them
    most = max(run.largest for run in within) / result.promised
    told = [
        f"Kept in all {len(within)} runs within the bounds: they reach {100 * most:.0f} % of it."
    ]
    others = [run for run in result.runs if not run.within]
    over = [run.plant for run in others if not run.keeps(result.promised)]
    if over:
        told.append(
            f"NOT FOR THE WHOLE FAMILY: {'; '.join(over)} left the tolerance. Nothing is promised "
            "for plants that differ from the model: load it on a machine whose delay and gains you "
            "know. `jcontour check --bound` bounds the error of a tuned loop on every plant."
        )
    elif others:
        told.append("The other plants kept it too, though nothing is promised for them.")
    return told


def _cells(run: KeptRun, promised: float) -> list[str]:
    return [
        run.plant,
        run.disturbance,
        digits(1e6 * run.largest),
        f"{100 * run.largest / promised:.0f} %",
        ", ".join(map(digits, run.control)),
        str(run.fallbacks),
        "" if run.left is None else str(run.left),
    ]
