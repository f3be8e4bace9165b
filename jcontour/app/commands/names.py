"""`jcontour list`: everything that has a name."""

from contextlib import suppress

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


def command(flags: Listing) -> int:
    """One line per name, by kind; exit code."""
    kinds = {"plants": MACHINES, "constrained": CONSTRAINED, "contours": CONTOURS}
    named = {
        kind: {name: entry.line for name, entry in entries.items()}
        for kind, entries in kinds.items()
    }
    named["controllers"] = {name: line_of(name) for name in CONTROLLERS}
    with suppress(ValueError):  # papers are in a checkout alone
        named["experiments"] = experiments_found()
    if flags.json:
        print(run_folder.json_text(named))
        return 0
    console = console_of()
    for kind, entries in named.items():
        heading = "Plants for --plant" if kind == "plants" else kind.capitalize()
        rows = [[name, line] for name, line in entries.items()]
        console.print(plain_table(heading, ["name", "what it is"], rows, 2))
    say(
        console,
        f"--plant also takes a machine file (JSON, npz; {EXAMPLE}), "
        "contours and parts a toolpath file (.ngc, .dxf, .svg, .csv).",
        f"--controller needs no {', '.join(PREFIXES)} in front: `cascade` is the cascade for "
        "the machine, `linear-cascade` on a linear one.",
    )
    return 0
