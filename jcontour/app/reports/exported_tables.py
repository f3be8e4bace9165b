"""What `jcontour export` tells."""

from rich.console import Console

from jcontour.app.files.results.exported_result import ExportedResult
from jcontour.app.reports import tables


def show_exported(found: ExportedResult, console: Console) -> None:
    """Files, what they hold, and how they were checked."""
    title = f"{found.controller} on {found.machine}: {found.contour}, {found.samples} samples"
    rows = [[name, words] for name, words in found.files.items()]
    console.print(tables.plain_table(title, ("file", "what it is"), rows, text_columns=2))
    sets = "one gain" if found.gain_sets == 1 else f"{found.gain_sets} different gains"
    tables.say(
        console,
        f"It remembers {found.states} numbers, and has {sets} along the path.",
        f"Its equations give the controls of `simulate` within {found.difference:.1e} "
        f"{found.control_unit}; the largest is {found.largest_control:.3g}.",
        f"Off its plan, numbers in {found.precision} precision change the controls by up to "
        f"{found.rounding:.1e} {found.control_unit}.",
        *(
            f"Checked: {one.compiler}: no warning, controls off the plan within "
            f"{one.difference:.1e} {found.control_unit}, {one.nanoseconds:.0f} ns a step"
            for one in found.compiled
        ),
    )
    if "controller.c" in found.files and not found.compiled:
        tables.say(console, "Not checked: there is no C compiler here.")
    if "controller.st" in found.files:
        tables.say(console, "Not checked: the structured text, which needs a PLC's compiler.")
    if not found.in_tables:
        tables.say(console, "The plan is too long for tables: plan.csv holds it, line by line.")
    tables.say(console, *(line for line in (found.start, found.end) if line))
    tables.say(console, *(f"WARNING: {line}" for line in found.warnings))
