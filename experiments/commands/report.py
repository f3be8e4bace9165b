"""`jcontour report RUN [RUN ...]`: one page of stored runs, to look at in any browser."""

from pathlib import Path

from experiments.files import run_folder
from experiments.flags.others import Report
from experiments.reports.page.html_page import FILE, write_page
from experiments.reports.tables import console_of, say

SUFFIXES = (".html", ".htm")


def command(flags: Report) -> int:
    """The whole command: write the page, exit code.

    Raises:
        ValueError: one of the runs has no page, or `out` is a file that is no page.
    """
    page = write_page(flags.runs, page_at(flags.out or flags.runs[0]))
    if flags.json:
        print(run_folder.json_text({"page": str(page), "bytes": page.stat().st_size}))
        return 0
    size = f"{1e-6 * page.stat().st_size:.2g} MB"
    say(
        console_of(),
        f"Page: {page}, {size}, of {_count(flags.runs)}.",
        "Next: open it in a browser; it needs no network, and prints as it is seen.",
    )
    return 0


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


def _count(runs: tuple[Path, ...]) -> str:
    return "one run" if len(runs) == 1 else f"{len(runs)} runs"
