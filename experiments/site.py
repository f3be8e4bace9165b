"""Tables of the site that are made from stored results, by the hook of mkdocs.

A line of a page becomes a table:

    <!-- statements of NAME -->   what a paper says, what we find, and the verdicts
    <!-- table 2 of NAME -->      the second table of its run
    <!-- rates of NAME -->        rates of a benchmark
    <!-- records of NAME -->      what a benchmark of records has stored
    <!-- ranking of NAME -->      controllers of a machine, by `jcontour rank`
`uv run python -m experiments.site RUN_FOLDER` stores statements and tables of a paper's run, and
the rows of a ranking beside those of other controllers on the same machine.
"""

import json
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from experiments.tables import Table

HERE = Path(__file__).parent
RANKINGS = HERE / "benchmarks" / "rankings.json"
PLACE = re.compile(
    r"^<!-- (statements|rates|records|ranking|table (\d+)) of ([\w-]+) -->$", re.MULTILINE
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


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def store(run: Path) -> Path:
    """Keep statements and tables of a run.

    Raises:
        ValueError: the run was a quick one, which decides less.
    """
    values, settings = _read(run / "result.json"), _read(run / "settings.json")
    if settings["command"] == "rank":
        rankings = _read(RANKINGS) if RANKINGS.exists() else {}
        rows = rankings.setdefault(values["machine"]["name"], {})
        kept = ("held_out", "peak_sensitivity", "evaluations", "stationary", "feasible", "failure")
        rows |= {row["label"]: [row.get(name) for name in kept] for row in values["rows"]}
        RANKINGS.write_text(json.dumps(rankings, indent=1) + "\n", encoding="utf-8")
        return RANKINGS
    if values["quick"]:
        raise ValueError(f"{run}: the pages need a whole run, this one is quick")
    path = stored(settings["command"].removeprefix("reproduce "))
    kept = {name: values[name] for name in ("claims", "tables")}
    path.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


def _made(place: re.Match[str]) -> str:
    what, number, name = place.groups()
    if what == "rates":
        last = _read(HERE / "benchmarks" / "results.json")[name][-1]
        rows = [[row, f"{rate:,.0f}"] for row, rate in last["rates"].items()]
        return _table([last["devices"], "per second"], rows)
    if what == "records":
        part = import_module(f"experiments.benchmarks.records.{name}")
        return _table([*part.COLUMNS], Table("", part.stored(), part.COLUMNS).cells)
    if what == "ranking":
        ranked = _read(RANKINGS)[name].items()
        placed = sorted((row for row in ranked if row[1][0]), key=lambda row: row[1][0])
        best = placed[0][1][0]
        rows = [
            [
                label,
                f"{1e6 * error:.3g}",
                f"{error / best:.2f}",
                f"{Ms:.3g}",
                str(points),
                ("ended" if ended else "not ended") if kept else "beyond a limit",
            ]
            for label, (error, Ms, points, ended, kept, _) in placed
        ]
        rows += [
            [label, "", "", "", "", re.split("[:;]", row[-1].removeprefix("controller: "))[0]]
            for label, row in ranked
            if not row[0]
        ]
        return _table(
            ["controller", "held out, um", "over the best", "Ms", "points", "search"], rows
        )
    run = _read(stored(name))
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
