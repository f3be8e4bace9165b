"""`jcontour report RUN [RUN ...]`: stored runs as one page for a browser, and side by side."""

from pathlib import Path

from jcontour.app.files import run_folder
from jcontour.app.files.results.stored import to_json
from jcontour.app.files.results.tuned_result import TunedResult
from jcontour.app.flags.others import Drive, Report
from jcontour.app.reports.comparison import (
    comparison,
    comparison_answer,
    is_comparable,
    show_comparison,
)
from jcontour.app.reports.drives import drive_gains
from jcontour.app.reports.page.page_data import FILE, stored_result, write_page
from jcontour.app.reports.screen import Entry, screen
from jcontour.app.reports.tables import console_of, say
from jcontour.app.runs.lifecycle import words_of

SUFFIXES = (".html", ".htm")


def command(flags: Report) -> int:
    """The whole command: write the page, compare the runs, exit code."""
    runs: tuple[Path, ...] = flags.runs
    first = runs[0]
    several = len(runs) > 1 and is_comparable(runs)
    gains = [] if flags.drive is None else _gains(first, flags.drive)
    if not (flags.page or several or gains):
        raise ValueError("report: --no-page needs two runs of tune, or two of simulate or audit")
    compared = comparison(runs) if several else None
    page = write_page(runs, page_at(flags.out or first)) if flags.page else None
    if flags.json:
        written = {} if page is None else {"page": str(page), "bytes": page.stat().st_size}
        if compared is not None:
            written["comparison"] = to_json(compared)
        if gains:
            written["gains"] = gains
        print(run_folder.json_text(written))
        return 0
    console, entries = console_of(), []
    if compared is not None:
        if flags.details:
            show_comparison(compared, console)
            say(console, "")
        entries += comparison_answer(compared)
    entries += [Entry("" if k else "Drive", line) for k, line in enumerate(gains)]
    if page is not None:
        size = f"{1e-6 * page.stat().st_size:.2g} MB"
        entries.append(Entry("Page", f"{page}, {size}"))
        entries.append(Entry("Open", "it in any browser; it needs no network, and prints"))
    if several and not flags.details:
        entries.append(Entry("Next", f"jcontour report{words_of(map(str, runs))} --details"))
    say(console, *screen(None, entries))
    return 0


def _gains(run: Path, drive: Drive) -> list[str]:
    """Gains of the nearest simple loop of a run, a line each."""
    result = stored_result(run)
    if not isinstance(result, TunedResult) or result.drive is None:
        raise run_folder.RunError(f"{run}: --drive needs a run of tune that tried a simple loop")
    return drive_gains(result.drive.weights, result.machine.control_unit, drive)


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
