"""`jcontour reproduce NAME`: the experiment of a paper, its figures, tables and verdicts.

A paper is a folder `experiments/papers/NAME` with two modules:

    experiment: SOURCE, run(quick) -> result, a frozen dataclass
    claims: claims(result) -> statements with their verdicts; FIGURES, name of a file -> function
        that draws it from the result; tables(result) -> tables and lines, where it has some
"""

import ast
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from jcontour.app.flags.rules import read
from jcontour.app.flags.shared import Common


@dataclass(frozen=True, kw_only=True)
class Flags(Common):
    """Flags of a paper."""

    quick: bool = False
    """Finish sooner, with less: the README of the papers says what is left out."""
    out: Path | None = None
    """Run folder; runs/<name>-<time> when not given. It must not hold another run."""


def experiments_found() -> dict[str, str]:
    """Name and first docstring line of every experiment module, read without importing them."""
    papers = in_checkout("reproduce", "experiments.papers")
    described = {}
    for path in sorted(Path(papers.__path__[0]).glob("*/experiment.py")):
        text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        described[path.parent.name.replace("_", "-")] = text.partition("\n")[0]
    return described


def chosen(name: str, arguments: Sequence[str]) -> tuple[Flags, Callable[[Flags], int]]:
    """Flags and runner of an experiment."""
    known = experiments_found()
    if name not in known:
        raise ValueError(
            f"reproduce: there is no experiment {name!r}; known are {', '.join(known) or 'none'}"
        )
    module = import_module(f"experiments.papers.{name.replace('-', '_')}.experiment")
    flags = read(Flags, arguments, f"jcontour reproduce {name}", known[name])
    return flags, lambda flags: _run(module, name, flags)


def _run(module: Any, name: str, flags: Flags) -> int:
    from jcontour.app.files import run_folder
    from jcontour.app.files.results.stored import to_json, write_result
    from jcontour.app.reports.figures.axes import save_figures
    from jcontour.app.reports.screen import Entry
    from jcontour.app.reports.tables import say
    from jcontour.app.runs.lifecycle import finished

    folder = run_folder.create(flags.out, f"reproduce {name}", flags, [])
    tables = in_checkout("reproduce", "experiments.tables")
    verdicts = in_checkout("reproduce", "experiments.papers.verdicts")
    said = import_module(f"{module.__package__}.claims")
    result = module.run(flags.quick)
    claims = tuple(said.claims(result))
    parts = tuple(said.tables(result)) if hasattr(said, "tables") else ()
    save_figures(said.FIGURES, result, folder)
    stored = {
        "source": module.SOURCE,
        "quick": flags.quick,
        **to_json(result),
        "tables": tables.stored(parts),
        "claims": to_json(claims),
    }
    write_result(folder, stored)

    def show(stored: Any, console: Any) -> None:
        say(console, module.SOURCE)
        tables.show(console, (*parts, verdicts.statements(claims)))

    missed = [Entry("Missed", line) for line in verdicts.missed(claims)]
    tally = Entry("Claims", verdicts.tally(claims, flags.quick))
    return finished(folder, stored, flags, show, [*missed, tally])


def command(flags: Any) -> int:
    """Tell which experiments there are, where no name is given."""
    print(
        f"jcontour: reproduce: give one of {', '.join(experiments_found()) or 'none yet'}",
        file=sys.stderr,
    )
    return 2


def in_checkout(command: str, module: str) -> ModuleType:
    """A module of the papers or the benchmarks."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if not module.startswith(str(error.name)):  # a package that it needs
            raise
        raise ValueError(
            f"{command}: papers and benchmarks are not in the installed package; clone the "
            "repository and run it there"
        ) from None
