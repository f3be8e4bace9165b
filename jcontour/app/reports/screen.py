"""The screen that a command ends in: at most 15 lines of 80 columns."""

import textwrap
from collections.abc import Sequence
from typing import NamedTuple

from jcontour.app.files.results.run_metrics import ContourRead
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.reports.tables import broken

WIDTH, LINES = 80, 15
INDENT = 9  # columns of the headings
FINDINGS = ("Warning", "Note")  # headings of entries that are left out first
EACH = 3  # lines of one entry; what is cut off is in the tables


class Entry(NamedTuple):
    """One statement of a screen, as "Margin" and its numbers; `jcontour ...` stays whole."""

    heading: str
    text: str


def read_notes(name: str, read: ContourRead | None) -> list[Entry]:
    """What of a part may be meant otherwise, and what of it is left out."""
    if read is None:
        return []
    ignored = [f"ignored: {', '.join(read.ignored)}"] if read.ignored else []
    return [Entry("Note", f"{name}: {line}") for line in (*read.warnings, *ignored)]


def screen(verdict: Verdict | None, entries: Sequence[Entry]) -> list[str]:
    """Lines of the screen: the verdict, its gravest reasons, the entries, the other findings.

    The remedy of the gravest reason is the next step where the entries name none. Findings that do
    not fit are counted; entries give up a line each for the first of them.

    Args:
        verdict: on the result; None for a command without one.
        entries: in their order.
    """
    messages = [] if verdict is None else verdict.messages
    against = [one for one in messages if one.level != "warning"]
    remedy = next((one.remedy for one in against if one.remedy), "")
    if remedy and all(one.heading != "Next" for one in entries):
        *others, last = entries
        entries = [*others, Entry("Next", remedy), last]
    findings = [Entry("Because", one.text) for one in against]
    findings += [Entry("Warning", one.line) for one in messages if one.level == "warning"]
    findings += [one for one in entries if one.heading in FINDINGS]
    head = [] if verdict is None else textwrap.wrap(verdict.heading, WIDTH)
    others = [one for one in entries if one.heading not in FINDINGS]
    rest = [line for one in others for line in _lines(one)]
    first = [*head, *(_lines(findings[0]) if findings else []), *findings[1:2]]
    if len(first) + len(rest) > LINES:
        rest = [line for one in others for line in _lines(one, EACH - 1)]
    shown: list[str] = []
    for count, one in enumerate(findings):
        more = _lines(one)
        last = count + 1 == len(findings)
        if len(head) + len(shown) + len(more) + (not last) + len(rest) > LINES:
            words = f"{len(findings) - count} more finding{'s' * (len(findings) - count > 1)}"
            shown += _lines(Entry("", f"{words}: --details"))
            break
        shown += more
    return [*head, *shown, *rest]


def _lines(entry: Entry, each: int = EACH) -> list[str]:
    """The entry, its text beside its heading, within the columns; a command is never cut."""
    first, *more = broken(f"{entry.heading:<{INDENT}}{entry.text}", WIDTH, INDENT).split("\n")
    if len(more) >= each and not entry.text.startswith("jcontour "):
        more = [*more[: each - 2], f"{more[each - 2][: WIDTH - 4].rstrip()} ..."]
    return [first, *more]
