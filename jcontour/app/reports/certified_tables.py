"""Tables that `jcontour check --bound` prints."""

from rich.console import Console

from jcontour.app.files.results.certified_result import CertifiedResult, CertifiedRow
from jcontour.app.reports.tables import digits, of_axes, of_inputs, peak_line, plain_table, say

HEADINGS = (
    "contour",
    "plant",
    "largest error\nproven um",
    "reached\nunder attack um",
    "reached by force\nwith counts um",
    "undisturbed\num",
    "largest\ncontrols",
)

BOUNDS = (
    "--force and --encoder-um set these bounds. Not given, they are the control noise of the "
    "machine (5 % of its control limit where its file states none) or the friction of its file, "
    "and half a count. Such a default does not measure cutting, nor friction that is not in the "
    "file: give your own."
)


def show_certified(result: CertifiedResult, console: Console) -> None:
    """The table, what it is proven for, and where the largest bound is."""
    title = f"Largest {result.error} error of {result.controller} on {result.machine.name}"
    rows = [_cells(row) for row in result.rows]
    console.print(plain_table(title, HEADINGS, rows, text_columns=2))
    say(console, *sentences(result))


def sentences(result: CertifiedResult) -> list[str]:
    """Assumptions, then the worst row in words."""
    worst, unit = result.worst, result.machine.control_unit
    place = peak_line(worst.place, result.error, result.machine.axes)
    return [
        f"Proven for every force of up to {digits(result.force)} {unit} on each control and every "
        f"encoder error of up to {of_axes(result.encoder, result.machine.axes)}, at each sample,",
        _plants(result.gain),
        BOUNDS,
        f"An attack reaches {digits(100 * worst.reached / worst.bound)} % of the largest bound; "
        f"{place}.",
        _controls(result),
    ]


def _controls(result: CertifiedResult) -> str:
    """Largest control of every input."""
    inputs = zip(*(row.control for row in result.rows), strict=True)
    largest = {k: max(one) for k, one in enumerate(inputs)}
    return f"No control exceeds {of_inputs(largest, result.machine.control_unit)}."


def _plants(gain: float | None) -> str:
    """Plants that the proof is of."""
    if gain is None:
        return (
            "and for each plant of the table, started on the path. Not for plants between them: "
            "`--cells 16` proves it for all their gains."
        )
    low, high = digits(1 - gain), digits(1 + gain)
    return (
        f"for every constant gain from {low} to {high} on each axis and every whole sample of "
        "delay, started on the path. Not for gains that change, nor parts of a sample."
    )


def _cells(row: CertifiedRow) -> list[str]:
    sizes = [row.bound, row.reached, row.counted, row.nominal]
    errors = [digits(None if size is None else 1e6 * size) for size in sizes]
    return [row.contour, row.plant, *errors, ", ".join(map(digits, row.control))]
