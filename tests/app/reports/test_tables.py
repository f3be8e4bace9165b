"""Lines that several commands print."""

import io
import shlex
from dataclasses import replace

import pytest
from rich.console import Console

from jcontour.app.files.results.run_metrics import ContourRead
from jcontour.app.reports.tables import broken, read_line, say


def test_what_rounding_leaves_of_zero_is_zero():
    read = ContourRead(
        pieces=1,
        length=0.1,
        duration=2.0,
        low=(4.1e-9, -1e-18),
        high=(0.1, 0.0462604),
        ignored=(),
    )
    line = read_line("task", read, ("X", "Y"))
    assert line == "task: 1 move, 100 mm in 2.000 s, X 0 ... 100, Y 0 ... 46.26 mm"
    stopped = read_line("task", replace(read, stops="1 stop: M3 at line 4"), ("X", "Y"))
    assert stopped.split("\n")[1:] == ["1 stop: M3 at line 4"]
    asked = read_line("task", replace(read, warnings=("line 3: a dwell of 500 s",)), ("X", "Y"))
    assert asked == f"{line}\nline 3: a dwell of 500 s"


def test_cut_and_rapid_lengths_are_told_apart():
    read = ContourRead(3, 0.245, 3.0404, (0.0,), (0.1,), rapid_length=6.3e-3)
    told = read_line("cap", read, "X")
    assert told.startswith("cap: 3 moves, 238.7 mm cut, 6.3 mm rapid in 3.040 s, X 0")


def said(width, *lines, terminal=True):
    out = io.StringIO()
    say(Console(file=out, force_terminal=terminal, color_system=None, width=width), *lines)
    return out.getvalue()


PROSE = "Of 1,000 machines at random, 3 are unstable: [see] the worst of them, which is late."


@pytest.mark.parametrize("width", [20, 40, 79])
def test_a_terminal_gets_lines_of_its_width_and_whole_words(width):
    printed = said(width, "short", PROSE, "two\nlines")
    assert max(len(line) for line in printed.splitlines()) <= width
    assert printed.split() == f"short {PROSE} two lines".split()
    assert said(width, PROSE, terminal=False) == f"{PROSE}\n"


@pytest.mark.parametrize("width", [30, 44, 60])
def test_a_command_can_be_copied_from_a_narrow_terminal(width):
    words = ["tune", "my own part.ngc", "--plant", "machine.json", "--weights", "alpha=1.2"]
    printed = said(width, f"   then: jcontour {shlex.join(words)}")
    assert max(len(line) for line in printed.splitlines()) <= width
    assert printed.count("\n") > 1
    assert shlex.split(printed.partition("jcontour")[2].replace("\\\n", "")) == words


def test_a_command_that_is_named_in_prose_is_prose():
    first, second = "Next: slower --overrides, or `jcontour", "tune` for this part first."
    assert broken(f"{first} {second}", 40) == f"{first}\n{second}"
