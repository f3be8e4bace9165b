"""`jcontour reproduce NAME`: the experiment module of that name, its figures and its verdicts.

An experiment is a module `experiments/papers/NAME/experiment.py` with SOURCE, PUBLISHED, Settings
(a dataclass: its fields are the flags, `quick` among them), and

    run(settings, folder) -> result: a frozen dataclass, `claims` among its fields,
    draw(result, folder) -> paths of the figures,   show(result, console).
"""

import ast
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import tyro

from jcontour.app.commands.checkout import in_checkout
from jcontour.app.flags.fitted_help import read

NEEDED = {"SOURCE", "PUBLISHED", "Settings", "run", "draw", "show"}


def experiments_found() -> dict[str, str]:
    """Name and first docstring line of every experiment module, read without importing them.

    Raises:
        ValueError: not in a checkout.
    """
    found = {}
    papers = in_checkout("reproduce", "experiments.papers")
    for path in sorted(Path(papers.__path__[0]).glob("*/experiment.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        if NEEDED <= set(_names(tree)):
            first_line, *_ = (ast.get_docstring(tree) or "").split("\n")
            found[path.parent.name.replace("_", "-")] = first_line
    return found


def _names(tree: ast.Module):
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            yield node.name
        elif isinstance(node, ast.Assign):
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            yield node.target.id
        elif isinstance(node, ast.ImportFrom):
            yield from (alias.asname or alias.name for alias in node.names)


def chosen(name: str, arguments: Sequence[str]) -> tuple[Any, Callable[[Any], int]]:
    """Flags and runner of an experiment.

    Raises:
        ValueError: no such experiment, or not in a checkout.
    """
    known = experiments_found()
    if name not in known:
        raise ValueError(
            f"reproduce: there is no experiment {name!r}; known are {', '.join(known) or 'none'}"
        )
    module = import_module(f"experiments.papers.{name.replace('-', '_')}.experiment")
    assert is_dataclass(module.Settings)

    Settings: Any = module.Settings

    @dataclass(frozen=True)
    class Flags:
        settings: tyro.conf.OmitArgPrefixes[Settings]
        """What is run."""
        out: Path | None = None
        """Run folder; runs/<name>-<time> when not given. It must not hold another run."""
        json: bool = False
        """Print the result as JSON on stdout, and nothing else there."""

    flags = read(Flags, arguments, f"jcontour reproduce {name}", known[name])
    return flags, lambda flags: _run(module, name, flags)


def _run(module: Any, name: str, flags: Any) -> int:
    from jcontour.app.files import run_folder
    from jcontour.app.files.results.stored import write_result
    from jcontour.app.reports import tables
    from jcontour.app.runs.lifecycle import finished

    place = flags.out or run_folder.default_folder(name)
    folder = run_folder.create(place, f"reproduce {name}", flags, [])
    result = module.run(flags.settings, folder)
    module.draw(result, folder)
    write_result(folder, result)

    def show(result: Any, console: Any) -> None:
        tables.say(console, str(module.SOURCE))
        module.show(result, console)

    verdicts = in_checkout("reproduce", "experiments.papers.verdicts")
    tally = verdicts.tally(result.claims, flags.settings.quick)
    last = [*verdicts.missed(result.claims), tally]
    return finished(folder, result, flags, show, last)


def command(flags: Any) -> int:
    """Tell which experiments there are, where no name is given."""
    print(
        f"jcontour: reproduce: give one of {', '.join(experiments_found()) or 'none yet'}",
        file=sys.stderr,
    )
    return 2
