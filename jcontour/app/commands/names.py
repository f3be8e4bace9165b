"""`jcontour list`: everything that has a name."""

from jcontour.app.catalogue.entries import (
    CONSTRAINED,
    CONTOURS,
    CONTROLLERS,
    MACHINES,
    PREFIXES,
    line_of,
)
from jcontour.app.commands.reproduce import experiments_found
from jcontour.app.files import run_folder
from jcontour.app.files.checks import EXAMPLE
from jcontour.app.flags.others import Listing
from jcontour.app.reports.tables import console_of, plain_table, say

HEADINGS = {"plants": "Plants for --plant"}


def run() -> dict[str, dict[str, str]]:
    """One line per name, by kind."""
    kinds = {
        "plants": MACHINES,
        "constrained": CONSTRAINED,
        "contours": CONTOURS,
    }
    named = {
        kind: {name: entry.line for name, entry in entries.items()}
        for kind, entries in kinds.items()
    }
    named["controllers"] = {name: line_of(name) for name in CONTROLLERS}
    try:
        return {**named, "experiments": experiments_found()}
    except ValueError:  # papers are in a checkout alone
        return named


def command(flags: Listing) -> int:
    """The whole command: list, exit code."""
    named = run()
    if flags.json:
        print(run_folder.json_text(named))
        return 0
    console = console_of()
    for kind, entries in named.items():
        console.print(
            plain_table(
                HEADINGS.get(kind, kind.capitalize()),
                ["name", "what it is"],
                [[name, line] for name, line in entries.items()],
                2,
            )
        )
    say(
        console,
        f"--plant also takes a machine file (JSON, npz; {EXAMPLE}), "
        "contours and parts a toolpath file (.ngc, .dxf, .svg, .csv).",
        f"--controller needs no {', '.join(PREFIXES)} in front: `cascade` is the cascade for "
        "the machine, `linear-cascade` on a linear one.",
    )
    return 0
