"""The page as one text: style, program and data inside."""

import html
import json
import re
from collections.abc import Sequence
from pathlib import Path

from jcontour.app.files import run_folder
from jcontour.app.reports.page.page_data import BYTES, page_data

FILE = "report.html"
MOST_BYTES = 5_000_000
HERE = Path(__file__).parent


def write_page(folders: Sequence[Path], path: Path) -> Path:
    """Write one page of these runs, in a folder that is made where there is none.

    Raises:
        RunError: as `page_data`; or the page would be larger than it may be.
    """
    runs = [page_data(folder, BYTES / len(folders)) for folder in folders]
    # The page; text of the user is escaped in the title, and never markup in the data
    title = "jcontour: " + ", ".join(run["name"] for run in runs)
    data = json.dumps(run_folder.plain(list(runs)), separators=(",", ":"), allow_nan=False)
    parts = {
        "TITLE": html.escape(title),
        "STYLE": (HERE / "page.css").read_text(),
        "DATA": data.replace("<", "\\u003c").replace("\u2028", " ").replace("\u2029", " "),
        "PLOTS": (HERE / "plots.js").read_text(),
        "PROGRAM": (HERE / "page.js").read_text(),
    }
    place = re.compile(f"@({'|'.join(parts)})@")
    text = place.sub(lambda found: parts[found[1]], (HERE / "page.html").read_text())
    if len(text.encode()) > MOST_BYTES:
        raise run_folder.RunError(
            f"{path}: the page would take {len(text.encode())} bytes; give fewer runs"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    return run_folder.write(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
