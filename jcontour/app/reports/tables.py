"""Tables and lines of text for people."""

import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from jcontour.app.files.results.run_metrics import METRICS, ContourRead, PeakPlace, RunMetrics
from jcontour.app.files.results.stored import Weight

WIDE = 110  # columns where the output is not a terminal
COMMAND = re.compile(r"(?<!`)\bjcontour(?: |$)")  # where one begins that is copied from the screen
QUOTED = re.compile(r"'[^']*'")
BLANK = "\0"  # in the place of one that is part of a word


def console_of(stderr: bool = False, quiet: bool = False) -> Console:
    """Where text goes; files and pipes are wide enough for every table."""
    console = Console(stderr=stderr, quiet=quiet)
    return console if console.is_terminal else Console(stderr=stderr, quiet=quiet, width=WIDE)


def say(console: Console, *lines: str) -> None:
    """Print lines as they are; on a terminal they are broken between words."""
    texts = [line for text in lines for line in text.split("\n")]
    if console.is_terminal:
        texts = [broken(line, console.width) for line in texts]
    console.print(*texts, sep="\n", markup=False, highlight=False, soft_wrap=True)


def broken(line: str, width: int, indent: int | None = None) -> str:
    r"""A line broken between words; a command goes on behind a backslash, as a shell reads it.

    A word that is wider stays whole. Further lines are indented like the first one, or as asked.

    >>> print(broken("Next: jcontour tune 'my part.ngc' --steps 30", 26))
    Next: jcontour tune \
    'my part.ngc' --steps 30
    """
    if len(line) <= width:
        return line
    begin, whole = COMMAND.search(line), line
    if begin is not None:  # the quoted words of the command stay in one piece
        at = begin.start()
        whole = line[:at] + QUOTED.sub(lambda one: one[0].replace(" ", BLANK), line[at:])
    pieces = textwrap.wrap(
        whole,
        width if begin is None else width - 2,
        break_long_words=False,
        break_on_hyphens=False,
        subsequent_indent=" " * (len(line) - len(line.lstrip()) if indent is None else indent),
    )
    text = pieces[0]
    for piece in pieces[1:]:
        text += f" \\\n{piece}" if COMMAND.search(text) else f"\n{piece}"
    return text.replace(BLANK, " ")


def digits(value: float | None) -> str:
    """Four significant digits; a dash for what is not finite."""
    return "-" if value is None or value - value != 0 else f"{value:.4g}"


def weight_digits(value: Weight) -> str:
    """A weight, or one for each axis with commas, as `--weights` reads them."""
    return ",".join(map(digits, value)) if isinstance(value, list) else digits(value)


def of_axes(lengths: float | Sequence[float], axes: Sequence[str]) -> str:
    """Lengths [m] in words: one of every axis, or one of each.

    >>> of_axes(5e-7, "XY"), of_axes((5e-7, 2.5e-6), "XY")
    ('0.5 um', '0.5 um on X, 2.5 um on Y')
    """
    if not isinstance(lengths, Sequence):
        return f"{digits(1e6 * lengths)} um"
    return ", ".join(
        f"{digits(1e6 * length)} um on {name}" for length, name in zip(lengths, axes, strict=True)
    )


def plain_table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 1
) -> Table:
    """A table whose first columns are text and wrap, and the others numbers.

    Where no column has a name there is no line of them.
    """
    table = Table(
        title=escape(title),
        title_justify="left",
        title_style="bold",
        pad_edge=False,
        box=SIMPLE_HEAD,
        show_header=any(columns),
    )
    for k, name in enumerate(columns):
        table.add_column(
            escape(name),
            justify="left" if k < text_columns else "right",
            no_wrap=k >= text_columns,
            overflow="fold",  # a name is never cut
        )
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    return table


Row = TypeVar("Row")


def table_of(
    title: str,
    rows: Iterable[Row],
    columns: Mapping[str, Callable[[Row], str | float | None]],
    text_columns: int = 1,
) -> Table:
    """A table of things: under each heading what is said of one; numbers in four digits."""
    cells = []
    for row in rows:
        values = [tell(row) for tell in columns.values()]
        cells.append([one if isinstance(one, str) else digits(one) for one in values])
    return plain_table(title, list(columns), cells, text_columns)


def columns_of(error: str) -> list[str]:
    """Metrics that mean something: a single axis has no contour error apart from tracking."""
    tabulated = [name for name, metric in METRICS.items() if metric.in_tables]
    return [name for name in tabulated if error == "contour" or "contour" not in name]


def metric_cells(metrics: RunMetrics, error: str) -> list[str]:
    """Columns of `columns_of`, in their units."""
    if metrics.diverged:
        return ["diverged"] * len(columns_of(error))
    return [digits(METRICS[name].factor * getattr(metrics, name)) for name in columns_of(error)]


def read_line(name: str, read: ContourRead, axes: Sequence[str]) -> str:
    """Summary of a contour in one line, then its stops and what may be meant otherwise."""
    box = ", ".join(
        f"{axis} {placed(1e3 * low)} ... {placed(1e3 * high)}"
        for axis, low, high in zip(axes, read.low, read.high, strict=True)
    )
    pieces = f"{read.pieces} move{'s' if read.pieces > 1 else ''}"
    lasting = "" if read.duration is None else f" in {read.duration / read.laps:.3f} s"
    line = f"{name}: {pieces}, {_length(read)}{lasting}, {box} mm{scored_words(read)}"
    if read.ignored:
        line += f"; ignored: {', '.join(read.ignored)}"
    return "\n".join([line, *filter(None, [read.stops]), *read.warnings])


def _length(read: ContourRead) -> str:
    """Length of the path, that of its cuts and of its rapid moves apart, or what is run of it."""
    if not read.rapid_length:
        whole = f"{1e3 * read.length:.5g} mm"
        if read.way is None or read.way >= read.length:
            return whole
        return f"the first {1e3 * read.way:.5g} of {whole}"
    cut = read.length - read.rapid_length
    return f"{1e3 * cut:.5g} mm cut, {1e3 * read.rapid_length:.5g} mm rapid"


def scored_words(read: ContourRead) -> str:
    """How often a run at constant feed goes around its path, and where its scoring begins."""
    if read.laps == 2.0 and read.entry == read.length:
        return "; 2 laps, the second is scored"
    several = f"{read.laps:.3g} laps, " if read.laps > 1.0 else ""
    entry = f"scored behind the first {1e3 * read.entry:.3g} mm" if read.entry else ""
    return f"; {several}{entry}" if entry else ""


def peak_line(peak: PeakPlace, error: str, axes: Sequence[str]) -> str:
    """Where the largest error is, in one line."""
    size = f"largest {error} error {1e6 * peak.error:.4g} um"
    return f"{size} {place_words(peak, axes)} (plant: {peak.plant})"


def place_words(peak: PeakPlace, axes: Sequence[str]) -> str:
    """Place and time of the largest error, and the line of the program."""
    line = "" if peak.line is None else f", line {peak.line} of the file"
    return f"at {position(axes, peak.position)}, t {placed(peak.time)} s{line}"


def position(axes: Sequence[str], values: Sequence[float]) -> str:
    """A position [m] in mm, axis by axis."""
    named = zip(axes, values, strict=True)
    return ", ".join(f"{axis} {placed(1e3 * value)}" for axis, value in named) + " mm"


def placed(value: float) -> str:
    """A place or a time, far from the origin too: three decimals, below 1 four digits.

    >>> placed(10004.98), placed(0.00125), placed(-1e-15)
    ('10004.98', '0.0013', '0')
    """
    value = round(value, 4) + 0.0  # mm to 0.1 um; what is less is rounding
    return f"{value:.4g}" if abs(value) < 1 else f"{value:.3f}".rstrip("0").rstrip(".")
