"""Tables of the site that are made from stored results, by the hook of mkdocs.

A line of a page becomes a table:

    <!-- statements of NAME -->   what a paper says, what we find, and the verdicts
    <!-- table 2 of NAME -->      the second table of its run
    <!-- rates of NAME -->        rates of a benchmark
    <!-- predictions of public --> what is predicted of public records
`uv run python -m experiments.site RUN_FOLDER` stores statements and tables of a paper's run.
"""

import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
PLACE = re.compile(
    r"^<!-- (statements|rates|predictions|table (\d+)) of ([\w-]+) -->$", re.MULTILINE
)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """A page with its tables.

    Raises:
        FileNotFoundError: no run of this paper is stored.
        LookupError: nothing is stored under this name or number.
    """
    return PLACE.sub(_made, markdown)


def stored(paper: str) -> Path:
    """File with the statements and tables of a paper."""
    return HERE / "papers" / paper.replace("-", "_") / "stored.json"


def store(run: Path) -> Path:
    """Keep statements and tables of a run.

    Raises:
        ValueError: the run was a quick one, which decides less.
    """
    values, settings = (
        json.loads((run / name).read_text(encoding="utf-8"))
        for name in ("result.json", "settings.json")
    )
    if values["quick"]:
        raise ValueError(f"{run}: the pages need a whole run, this one is quick")
    path = stored(settings["command"].removeprefix("reproduce "))
    kept = {name: values[name] for name in ("claims", "tables")}
    path.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


def _made(place: re.Match[str]) -> str:
    what, number, name = place.groups()
    if what == "rates":
        results = json.loads((HERE / "benchmarks" / "results.json").read_text(encoding="utf-8"))
        last = results[name][-1]
        rows = [[row, f"{rate:,.0f}"] for row, rate in last["rates"].items()]
        return _table([last["devices"], "per second"], rows)
    if what == "predictions":
        records = HERE / "benchmarks" / "records" / f"{name}.json"
        rows = [
            [*list(row.values())[:-1], "yes" if row["holds"] else "**no**"]
            for row in json.loads(records.read_text(encoding="utf-8"))
        ]
        return _table(["record", "quantity", "measured", "predicted", "holds"], rows)
    run = json.loads(stored(name).read_text(encoding="utf-8"))
    if what == "statements":
        keys = ("item", "claim", "finding", "verdict")
        rows = [[claim[key] for key in keys] for claim in run["claims"]]
        return _table(["where", "the paper", "the simulation", "verdict"], rows)
    table = run["tables"][int(number) - 1]
    return f"{table['title']}\n\n{_table(table['headings'], table['cells'])}"


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [headings, ["---"] * len(headings), *rows]
    cells = [[cell.replace("|", "&#124;").replace("\n", " ") for cell in line] for line in lines]
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)


if __name__ == "__main__":
    for folder in sys.argv[1:]:
        print(store(Path(folder)))
