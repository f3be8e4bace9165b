"""`jcontour compare`: what changed between two tuned runs, and which is better where."""

from pathlib import Path
from typing import Any

from experiments.files import run_folder
from experiments.options import Compare
from experiments.reports import tables
from experiments.reports.tables import COLUMNS, columns_of, digits

UNCOMPARED = ("json", "out", "resume")
SAME = 1e-3  # relative: a smaller difference is called none


def run(first: Path, second: Path) -> dict[str, Any]:
    """Settings that differ, weights, and every metric of every contour that both runs have.

    Raises:
        RunError: a folder is not that of a finished tuning run.
    """
    settings = [run_folder.opened(folder, "tune") for folder in (first, second)]
    results = [run_folder.read_json(folder, run_folder.RESULT) for folder in (first, second)]
    flags = [one["flags"] for one in settings]
    keys = sorted({key for one in flags for key in one} - set(UNCOMPARED))
    changed = {
        key: [one.get(key) for one in flags]
        for key in keys
        if flags[0].get(key) != flags[1].get(key)
    }
    try:
        rows = _rows(*results)
        weights = {
            name: [one["weights"][name] for one in results] for name in results[0]["weights"]
        }
        safety = {
            name: [one["safety"][name] for one in results]
            for name in ("largest_frozen_spectral_radius", "delay_samples")
        }
    except (KeyError, TypeError):
        raise run_folder.RunError(
            f"{first}, {second}: their results are not those of this version's tune"
        ) from None
    versions = {
        key: [one.get("versions", {}).get(key) for one in settings]
        for key in settings[0].get("versions", {})
        if settings[0]["versions"].get(key) != settings[1].get("versions", {}).get(key)
    }
    return {
        "runs": [str(first), str(second)],
        "settings": changed,
        "versions": versions,
        "weights": weights,
        "safety": safety,
        "metrics": rows,
        "better": {
            side: sum(row["better"] == side for row in rows) for side in ("first", "second", "same")
        },
    }


def _rows(first: dict[str, Any], second: dict[str, Any]) -> list[dict[str, Any]]:
    others = {contour["name"]: contour for contour in second["contours"]}
    rows = []
    for contour in first["contours"]:
        other = others.get(contour["name"])
        if other is None:
            continue
        for plant in ("nominal", "worst"):
            for name, _, _ in columns_of(first["error"]):
                values = [one["metrics"]["tuned"][plant][name] for one in (contour, other)]
                row = {
                    "contour": contour["name"],
                    "plant": plant,
                    "metric": name,
                    "first": values[0],
                    "second": values[1],
                }
                rows.append(
                    {
                        **row,
                        "training": [contour["training"], other["training"]],
                        "better": _better(*values),
                    }
                )
    return rows


def _better(first: float | None, second: float | None) -> str:
    if first is None or second is None:
        return "same" if first is second else ("second" if first is None else "first")
    if abs(first - second) <= SAME * max(abs(first), abs(second)):
        return "same"
    return "first" if first < second else "second"


def command(flags: Compare) -> int:
    """The whole command: compare, print, exit code."""
    summary = run_folder.plain(run(flags.first, flags.second))
    if flags.json:
        print(run_folder.json_text(summary))
        return 0
    console = tables.console_of()
    changes = [
        [key, str(a), str(b)]
        for part in ("settings", "versions", "weights")
        for key, (a, b) in summary[part].items()
        if a != b
    ]
    changes += [
        [key.replace("_", " "), digits(a), digits(b)] for key, (a, b) in summary["safety"].items()
    ]
    console.print(tables.plain_table("What changed", ["", *summary["runs"]], changes))
    factors = {name: (heading.replace("\n", " "), factor) for name, heading, factor in COLUMNS}
    rows = [
        [
            row["contour"],
            row["plant"],
            factors[row["metric"]][0],
            *(
                digits(None if row[side] is None else row[side] * factors[row["metric"]][1])
                for side in ("first", "second")
            ),
            row["better"],
        ]
        for row in summary["metrics"]
    ]
    console.print(
        tables.plain_table(
            "Tuned weights of both, smaller is better",
            ["contour", "plant", "metric", "first", "second", "better"],
            rows,
            3,
        )
    )
    count = summary["better"]
    tables.say(
        console,
        f"first better in {count['first']}, second in {count['second']}, same within 0.1 % in {count['same']}",
    )
    return 0
