"""The screen that a command ends in: what is left out where there is too much."""

import re

import pytest

from jcontour.app.files.results.verdict import Verdict, reason, warning
from jcontour.app.reports.screen import LINES, WIDTH, Entry, next_step, screen

ENTRIES = [Entry("Error", "4 um"), Entry("Note", "a doubt"), Entry("Folder", "runs/tune")]


@pytest.mark.parametrize("count", [1, 5, 40])
def test_findings_that_do_not_fit_are_counted(count):
    against = [reason(f"{k} {'is too long a sentence ' * (k % 5)}") for k in range(count)]
    lines = screen(Verdict.of([], [*against, warning("look")]), ENTRIES)
    assert len(lines) <= LINES and max(map(len, lines)) <= WIDTH
    assert lines[0] == "DO NOT USE THESE VALUES" and lines[-1] == "Folder   runs/tune"
    shown = sum(line.startswith(("Because", "Warning", "Note")) for line in lines)
    left = re.findall(r"(\d+) more (?:reason|warning|note)", "\n".join(lines))
    assert shown + sum(map(int, left)) == count + 2


def test_the_remedy_of_the_gravest_reason_is_the_next_step():
    verdict = Verdict.of([], [reason("late"), reason("loud", "less gain"), reason("off", "none")])
    lines = screen(verdict, ENTRIES)
    assert lines[-2] == "Advice   less gain" and "Because  loud" in lines
    lines = screen(verdict, [next_step("jcontour list"), *ENTRIES])
    assert "Next     jcontour list" in lines and "Advice   less gain" not in lines


def test_the_gravest_finding_and_every_entry_stand_on_a_full_screen():
    """Three lines of the finding, its count of others, and eleven entries in 15 lines."""
    long = [Entry(f"Entry {k}", f"is {'a long statement ' * 10}") for k in range(7)]
    verdict = Verdict.of([], [reason("much to say " * 14), *map(warning, "abcdef")])
    lines = screen(verdict, [*long, next_step("jcontour list"), Entry("Folder", "runs/tune")])
    assert len(lines) <= LINES and lines[1].startswith("Because  much")
    assert [line[:7] for line in lines if line.startswith("Entry")] == [
        f"Entry {k}" for k in range(7)
    ]
    assert "6 more warnings" in "".join(lines) and lines[-2:] == [
        "Next     jcontour list",
        "Folder   runs/tune",
    ]


def test_without_a_verdict_the_screen_begins_with_its_entries():
    lines = screen(None, [Entry("X", "a model"), Entry("Note", "coarse"), Entry("Folder", "runs")])
    assert lines == ["X        a model", "Note     coarse", "Folder   runs"]


def test_a_command_is_never_cut():
    words = " ".join(f"--weights gain_{k}=1.234" for k in range(20))
    lines = screen(None, [Entry("Next", f"jcontour tune {words}")])
    assert all(line.endswith(" \\") for line in lines[:-1])
    assert " ".join(" ".join(lines).replace("\\", "").split()) == f"Next jcontour tune {words}"


def test_long_entries_make_room_for_the_first_finding():
    entries = [Entry(f"Entry {k}", "words " * 40) for k in range(4)]  # three lines each
    lines = screen(Verdict.of([], [warning("look"), warning("listen")]), [*entries, *ENTRIES])
    assert "Warning  look" in lines and len(lines) <= LINES
