"""`jcontour report RUN [RUN ...]`: stored runs as one page for a browser, and side by side."""

from pathlib import Path

from jcontour.app.commands import compare
from jcontour.app.files import run_folder
from jcontour.app.files.results.stored import to_json
from jcontour.app.flags.others import Report
from jcontour.app.reports.page.page_data import FILE, write_page
from jcontour.app.reports.screen import Entry, screen
from jcontour.app.reports.tables import console_of, say

SUFFIXES = (".html", ".htm")
COMPARED = ({"tune"}, {"simulate", "audit"})  # commands whose runs are compared


def command(flags: Report) -> int:
    """The whole command: write the page, compare each run with the first, exit code.

    Raises:
        ValueError: one of the runs has no page, `out` is a file that is no page, or there is
            nothing to compare where no page is asked for.
    """
    compared = flags.runs[1:] if _comparable(flags.runs) else ()
    if not flags.page and not compared:
        raise ValueError("report: --no-page needs two runs of tune, or two of simulate or audit")
    results = [compare.run(flags.runs[0], other) for other in compared]
    page = write_page(flags.runs, page_at(flags.out or flags.runs[0])) if flags.page else None
    if flags.json:
        written = {} if page is None else {"page": str(page), "bytes": page.stat().st_size}
        print(run_folder.json_text(written | {"comparisons": [to_json(one) for one in results]}))
        return 0
    console, entries = console_of(), []
    for one in results:
        if flags.details:
            compare.show(one, console)
        entries += compare.answer(one)
    if page is not None:
        entries.append(Entry("Page", f"{page}, {1e-6 * page.stat().st_size:.2g} MB"))
        entries.append(Entry("Next", "open it in a browser; it needs no network, and prints"))
    elif not flags.details:
        entries.append(Entry("Next", "--details prints every number of both"))
    say(console, *([""] if flags.details else []), *screen(None, entries))
    return 0


def _comparable(runs: tuple[Path, ...]) -> bool:
    """Whether all runs are of commands whose runs are compared."""
    commands = {run_folder.read_json(one, run_folder.SETTINGS).get("command") for one in runs}
    return any(commands <= alike for alike in COMPARED)


def page_at(out: Path) -> Path:
    """The page that a name stands for: itself, or `FILE` in a folder.

    Raises:
        RunError: there is a file of the folder's name.
    """
    if out.suffix.lower() in SUFFIXES and not out.is_dir():
        return out
    if out.exists() and not out.is_dir():
        raise run_folder.RunError(f"{out}: is a file; give a folder, or a name ending in .html")
    return out / FILE
