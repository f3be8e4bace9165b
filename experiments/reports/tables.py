"""Tables and blocks of text for people, from the plain numbers of a result."""

from collections.abc import Iterable, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

COLUMNS = (  # metric, heading, factor from SI
    ("rms_contour_error", "RMS\ncontour\nerror um", 1e6),
    ("peak_contour_error", "peak\ncontour\nerror um", 1e6),
    ("rms_tracking_error", "RMS\ntracking\nerror um", 1e6),
    ("peak_tracking_error", "peak\ntracking\nerror um", 1e6),
    ("rms_control", "RMS\ncontrol\n", 1.0),
    ("rms_increment", "RMS\ncontrol\nincrement", 1.0),
)


WORDS = (
    "where",
    "the paper",
    "the simulation",
    "case",
    "weights",
    "verdict",
)  # columns of `worded_table` that wrap
WIDE = 110  # columns where the output is not a terminal


def console_of(stderr: bool = False, quiet: bool = False) -> Console:
    """Where text goes; files and pipes are wide enough for every table."""
    console = Console(stderr=stderr, quiet=quiet)
    return console if console.is_terminal else Console(stderr=stderr, quiet=quiet, width=WIDE)


def say(console: Console, *lines: str) -> None:
    """Print lines as they are."""
    console.print(*lines, sep="\n", markup=False, highlight=False, soft_wrap=True)


def digits(value: float | None) -> str:
    """Four significant digits; a dash for what is not finite."""
    return "-" if value is None or value - value != 0 else f"{value:.4g}"


def plain_table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 1
) -> Table:
    """A table whose first columns are text and the others numbers."""
    table = Table(
        title=title, title_justify="left", title_style="bold", pad_edge=False, box=SIMPLE_HEAD
    )
    for k, name in enumerate(columns):
        table.add_column(
            name,
            justify="left" if k < text_columns else "right",
            no_wrap=k == 0 or k >= text_columns,
        )
    for row in rows:
        table.add_row(*row)
    return table


def worded_table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """A table of a paper: columns of words wrap, the others hold numbers."""
    table = Table(
        title=escape(title),
        title_justify="left",
        title_style="bold",
        box=SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 1, 0, 0),
    )
    for heading in headings:
        words = heading in WORDS
        table.add_column(heading, justify="left" if words else "right", no_wrap=not words)
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    return table


def columns_of(error: str) -> tuple[tuple[str, str, float], ...]:
    """Columns that mean something: on a single axis there is no contour error apart from that of tracking."""
    return tuple(column for column in COLUMNS if error == "contour" or "contour" not in column[0])


def design_tables(result: dict[str, Any]) -> list[Table]:
    """Start against tuned, training and held-out contours apart, nominal plant and worst of the family."""
    columns = [
        "contour",
        "plant",
        "weights",
        *(heading for _, heading, _ in columns_of(result["error"])),
    ]
    made = []
    for seen, title in (
        (True, "Training contours"),
        (False, "Held-out contours (never seen by the tuner)"),
    ):
        rows = [
            row
            for one in result["contours"]
            if one["training"] is seen
            for row in _contour_rows(one, result["error"])
        ]
        if rows:
            made.append(
                plain_table(
                    f"{title}, machine with {result['machine']['truth']}",
                    columns,
                    rows,
                    text_columns=3,
                )
            )
    return made


def _contour_rows(contour: dict[str, Any], error: str) -> list[list[str]]:
    rows = []
    for plant in ("nominal", "worst"):
        for design, metrics in contour["metrics"].items():
            lost = metrics[plant]["diverged"]
            cells = [
                "diverged" if lost else digits(_scaled(metrics[plant][name], factor))
                for name, _, factor in columns_of(error)
            ]
            first_of_plant = design == next(iter(contour["metrics"]))
            rows.append(
                ["" if rows else contour["name"], plant if first_of_plant else "", design, *cells]
            )
    return rows


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def show_tuned(result: dict[str, Any], console: Console) -> None:
    """Everything a tuning run found."""
    for table in design_tables(result):
        console.print(table)
    say(console, *values_block(result), "")


def values_block(result: dict[str, Any]) -> list[str]:
    """The block "use these values"."""
    safety = result["safety"]
    lines = [
        "",
        "USE THESE VALUES" if result["usable"] else "DO NOT USE THESE VALUES: see the warnings",
        *(f"  {line}" for line in result["values"]),
    ]
    lines += [
        f"How safe they are (frozen loops, up to {safety['probes_per_contour']} points of each training contour)",
        *(
            f"  {name:<23}  {value:<24} start: {before}"
            for name, value, before in _safety_rows(safety, result["safety_of_start"])
        ),
        *_lost_first_line(safety["lost_first"], result["machine"]["axes"]),
    ]
    lines += [
        f"Gap of the machine with {result['machine']['truth']} to the smooth one that was tuned",
        *map(_gap_line, result["gap"]),
    ]
    if result["confirmed"]:
        lines += [
            f"The same runs in {result['confirmed'][0]['engine']}, nominal plant",
            *map(_confirmed_line, result["confirmed"]),
        ]
    return [*lines, *(f"WARNING: {line}" for line in result["warnings"])]


def _confirmed_line(row: dict[str, Any]) -> str:
    errors = f"{1e6 * row['ours']:.6g} -> {1e6 * row['theirs']:.6g} um RMS"
    return f"  {row['contour']:<23} {errors}, tools at most {1e6 * row['apart']:.2g} um apart"


def _gap_line(row: dict[str, Any]) -> str:
    where = f"  {row['contour']}, {row['plant']}"
    if row["relative"] is None:
        return f"{where}: diverged"
    return f"{where:<25} {1e6 * row['smooth']:.5g} -> {1e6 * row['true']:.5g} um RMS ({100 * row['relative']:+.2f} %)"


def _safety_rows(*designs: dict[str, Any]) -> list[tuple[str, ...]]:
    """One row per margin: its name, then its value for every design."""
    rows = [
        (
            "largest spectral radius",
            *(f"{one['largest_frozen_spectral_radius']:.6f} (stable < 1)" for one in designs),
        )
    ]
    for k in range(len(designs[0]["gain_range"])):
        rows.append((f"gain margin, input {k + 1}", *(_gain_range(one, k) for one in designs)))
    return [*rows, ("delay margin", *(_delay(one) for one in designs))]


def _lost_first_line(place: dict[str, Any] | None, axes: Sequence[str]) -> list[str]:
    if place is None:
        return []
    reference = ", ".join(
        f"{name} {1e3 * value:.4g}" for name, value in zip(axes, place["position"], strict=True)
    )
    return [
        f"  {'stability lost first':<23}  input {place['input']}, on {place['contour']} where the reference is at {reference} mm"
    ]


def _gain_range(safety: dict[str, Any], k: int) -> str:
    low, high = safety["gain_range"][k]
    return f"x {_bounded(low, safety, 0)} ... {_bounded(high, safety, 1)}"


def _bounded(value: float, safety: dict[str, Any], side: int) -> str:
    bound = safety["gain_search"][side]
    beyond = value <= bound if side == 0 else value >= bound
    return f"{bound:.4g} or {'less' if side == 0 else 'more'}" if beyond else f"{value:.4g}"


def _delay(safety: dict[str, Any]) -> str:
    found = safety["delay_samples"]
    if found < 0:
        return "none: unstable as it is"
    more = " or more" if found >= safety["delay_search"] else ""
    return f"{found}{more} extra samples"


def plant_table(summary: dict[str, Any]) -> Table:
    """A simulation: one row per plant of the family."""
    columns = columns_of(summary["error"])
    rows = [
        [
            plant,
            *(
                "diverged" if metrics["diverged"] else digits(_scaled(metrics[name], factor))
                for name, _, factor in columns
            ),
        ]
        for plant, metrics in summary["plants"].items()
    ]
    machine = summary["machine"]
    title = f"{summary['controller']} on {summary['contour']}, {summary['samples']} samples, {summary['feed_law']}, {machine['truth']}"
    return plain_table(title, ["plant", *(heading for _, heading, _ in columns)], rows)
