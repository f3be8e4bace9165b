"""First and last lines of every command: its run folder and its answer."""

import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import Field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from tyro.conf import Positional

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.catalogue.own_classes import own_name
from jcontour.app.files import run_folder
from jcontour.app.files.results.stored import versioned
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.flags.shared import Common, Controlled, MachineFlags, Storage
from jcontour.app.reports import tables
from jcontour.app.reports.page.page_data import FILE, KINDS, write_page
from jcontour.app.reports.screen import Entry, screen

OF_A_CALL = ("json", "details", "out", "resume")  # flags of one call, and not of its task
WHERE = ("json", "details", "trust_code", "devices")  # flags a run may go on with
FILES = (
    "plant",
    "controller",
    "contour",
    "tool_table",
    "machine_limits",
)  # flags that may name a file
F = TypeVar("F", bound=Storage)
Kept = TypeVar("Kept")
Asked = TypeVar("Asked")
Result = TypeVar("Result")


@contextmanager
def opened(flags: F, command: str, read: Callable[[F], Asked]) -> Iterator[tuple[Path, Asked]]:
    """Folder of a new run or of the one to go on with, and what `read` makes of its flags.

    `read` comes first: bad input is refused before anything is written. The folder is held until
    the run ends, and whoever interrupts it reads how it goes on.
    """
    if flags.resume:
        folder, flags = resumed(flags, command)
        asked = read(flags)
    else:
        asked = read(flags)
        folder = created(flags, command)
    with run_folder.locked(folder), run_folder.resumable(command, folder):
        yield folder, asked


def created(flags: Any, command: str) -> Path:
    """New run folder where the flags say, with their values and copies of the files they name.

    Raises:
        RunError: the folder holds something already, or cannot be made.
    """
    folder = flags.out or run_folder.default_folder(command)
    passing = {
        "json": False,
        "details": False,
        "trust_code": False,
        "out": None,
    }  # of this call; few take all
    kept = replace(flags, **{name: off for name, off in passing.items() if hasattr(flags, name)})
    return run_folder.create(folder, command, kept, inputs(flags))


def task_words(
    parts: Sequence[str], flags: Mapping[str, Any], kind: type[Common] = MachineFlags
) -> str:
    """Parts and flags as words of a command line, with a space before."""
    words = [*parts]
    for one in fields(kind):
        value = flags.get(one.name, one.default)
        if one.name in OF_A_CALL or _is_positional(one) or value == one.default or value == []:
            continue
        several, name = isinstance(value, (tuple, list)), one.name.replace("_", "-")
        if isinstance(value, bool):
            words.append(f"--{name}" if value else f"--no-{name}")
        else:
            words += [f"--{name}", *map(str, value if several else [value])]
    return words_of(words)


def tuning_words(parts: Sequence[str], flags: Mapping[str, Any]) -> str:
    """The words with which `jcontour tune` tunes the controller of another command.

    A preview of all samples of the run is left out: it is not for tuning.
    """
    known = {name: value for name, value in flags.items() if (name, value) != ("preview", "path")}
    return task_words(parts, known, Controlled)


def ranked_words(folder: Path) -> str:
    """The words with which `jcontour rank` ranks controllers on the task of a tuned run.

    A controller of the user's own is ranked beside the usual one of the machine, if it has one.
    """
    stored = run_folder.opened(folder, "tune")
    flags = stored["flags"]
    task, controller = task_words(flags["parts"], flags), flags.get("controller")
    if controller is None or own_name(controller) is None:
        return task
    usual = machine_named(_with_copies(stored, folder)["plant"]).usual.controller
    return task + words_of(["--controllers", *filter(None, [usual, controller])])


def words_of(words: Iterable[str]) -> str:
    """Words of a command line as a shell reads them, each with a space before."""
    return "".join(f" {shlex.quote(word)}" for word in words)


def inputs(flags: Any) -> list[Path]:
    """Files that the flags name as machine, controller, contour, parts or tool table."""
    names = [getattr(flags, name, None) for name in FILES]
    names += getattr(flags, "parts", ())
    named = [(name, own_name(name)) for name in names if name]
    paths = [Path(name) if own is None else own.path for name, own in named]
    return list(dict.fromkeys(path for path in paths if path.suffix))


def resumed(flags: F, command: str) -> tuple[Path, F]:
    """Folder and flags of the run that `--resume` names.

    It reads its own copies of its input files, on the devices named now.
    """
    folder = flags.resume
    assert folder is not None
    now = {name: getattr(flags, name) for name in WHERE if hasattr(flags, name)}
    for one in fields(flags):
        if one.name not in ("resume", *now) and getattr(flags, one.name) != one.default:
            given, typed = getattr(flags, one.name), f"--{one.name.replace('_', '-')}"
            if _is_positional(one):
                typed = words_of(given if isinstance(given, (tuple, list)) else [str(given)])
            words = "resume: the run keeps its own settings; leave out"
            raise ValueError(f"{words} {typed.strip()}")
    return folder, stored_flags(folder, command, type(flags), **now, resume=None)


def _is_positional(one: Field) -> bool:
    return Positional in getattr(one.type, "__metadata__", ())


def stored_flags(folder: Path, command: str, kind: type[Kept], **now: Any) -> Kept:
    """Flags of a stored run, with the folder's copies of its input files."""
    stored = run_folder.opened(folder, command)
    try:
        return kind(**{**_with_copies(stored, folder), **now, "out": None})
    except (TypeError, KeyError):
        raise run_folder.RunError(
            f"{folder}: its settings are not those of this version's {command}"
        ) from None


def _with_copies(stored: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Flags of a stored run, with the folder's copies in place of the files they name."""
    copies = {name: str(folder / copy) for name, copy in stored.get("inputs", {}).items()}
    known: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in stored["flags"].items()
    }

    def copied(name: str) -> str:
        own = own_name(name)
        if own is None:
            return copies.get(name, name)
        return f"{copies.get(str(own.path), own.path)}:{own.name}"

    named = [name for name in FILES if known.get(name)]
    known |= {name: copied(known[name]) for name in named}
    if "parts" in known:
        known["parts"] = tuple(copied(name) for name in known["parts"])
    return known


def finished(
    folder: Path,
    result: Result,
    flags: Any,
    show: Callable[[Result, Console], None],
    answer: Sequence[Entry] = (),
    verdict: Verdict | None = None,
) -> int:
    """Print a result that is stored; the exit code of its verdict, 0 where there is none.

    With `--json` one JSON object; else a screen, which begins with the verdict. With `--details`
    what `show` prints, every finding of the verdict and the figures in the folder stand before it.
    """
    page, code = "", 0 if verdict is None else verdict.exit_code
    if run_folder.read_json(folder, run_folder.SETTINGS).get("command") in KINDS:
        try:
            page = f", page {write_page([folder], folder / FILE).name}"
        except run_folder.RunError as error:  # the run itself is good
            page = f", no page ({error})"
    if flags.json:
        print(run_folder.json_text({"run": str(folder), **versioned(result)}))
        return code
    console = tables.console_of()
    if flags.details:
        show(result, console)
        drawn = sorted(path.name for path in folder.glob("*.png"))
        lines = [] if verdict is None else ["", *verdict.lines[1:]]
        tables.say(console, *lines, *([f"Drawn: {', '.join(drawn)}"] if drawn else []), "")
    place = Entry("Folder", f"{folder}{page}; --details: every table")
    tables.say(console, *screen(verdict, [*answer, place]))
    return code
