"""The screen that a command ends in: at most 15 lines of 80 columns."""

import textwrap
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from jcontour.app.files.results.run_metrics import ContourRead
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.reports.tables import broken

WIDTH, LINES = 80, 15
INDENT = 9  # columns of the headings
FINDINGS = ("Warning", "Note")  # headings of entries that are left out first
LEVELS = {"Because": "reason", "Warning": "warning", "Note": "note"}  # of findings, as counted
WHOLE = ("Next", "Drive", "To load", "Folder")  # headings of entries that are never cut
EACH = 3  # lines of any other entry; what is cut off is in the tables
COMMAND = "jcontour "


class Entry(NamedTuple):
    """One statement of a screen, as "Margin" and its numbers; `jcontour ...` stays whole."""

    heading: str
    text: str


def next_step(text: str) -> Entry:
    """A command to type, headed Next; what else helps is headed Advice."""
    return Entry("Next" if text.startswith(COMMAND) else "Advice", text)


def read_notes(name: str, read: ContourRead | None) -> list[Entry]:
    """What of a part may be meant otherwise, and what of it is left out."""
    if read is None:
        return []
    ignored = [f"ignored: {', '.join(read.ignored)}"] if read.ignored else []
    return [Entry("Note", f"{name}: {line}") for line in (*read.warnings, *ignored)]


def screen(verdict: Verdict | None, entries: Sequence[Entry]) -> list[str]:
    """Lines of the screen: the verdict, the findings, the entries.

    The gravest finding and every entry always stand: the longest are cut until all of them fit.
    Further findings that do not fit are counted. The remedy of the gravest reason is the next step
    where the entries name none. Without a verdict the findings stand where the first note is.

    Args:
        verdict: on the result; None for a command without one.
        entries: in their order.
    """
    messages = [] if verdict is None else verdict.messages
    against = [one for one in messages if one.level != "warning"]
    remedy = next((one.remedy for one in against if one.remedy), "")
    if remedy and all(one.heading not in ("Next", "Advice") for one in entries):
        *others, last = entries
        entries = [*others, next_step(remedy), last]
    findings = [Entry("Because", one.text) for one in against]
    findings += [Entry("Warning", one.line) for one in messages if one.level == "warning"]
    findings += [one for one in entries if one.heading in FINDINGS]
    headings = [one.heading in FINDINGS for one in entries]
    before = headings.index(True) if verdict is None and any(headings) else 0
    head = [] if verdict is None else textwrap.wrap(verdict.heading, WIDTH)
    first, shown = findings[:1], [one for one in entries if one.heading not in FINDINGS]
    kept = [*first, *shown]
    blocks = [_lines(one) for one in kept]
    room = LINES - len(head) - (len(findings) > 1)
    while sum(map(len, blocks)) > room:
        sizes = [len(block) - (one in first) for one, block in zip(kept, blocks, strict=True)]
        k = max(range(len(kept)), key=lambda k: (not _whole(kept[k]), sizes[k], k))
        if _whole(kept[k]) or sizes[k] <= 1:
            break
        blocks[k] = _lines(kept[k], len(blocks[k]) - 1)
    top = [line for block in blocks[: len(first)] for line in block]
    blocks = blocks[len(first) :]
    room = LINES - len(head) - len(top) - sum(map(len, blocks))
    for count, one in enumerate(findings[1:], 1):
        more = _lines(one)
        if len(more) + (count + 1 < len(findings)) > room:
            levels = Counter(LEVELS[one.heading] for one in findings[count:])
            words = ", ".join(f"{n} more {level}{'s' * (n > 1)}" for level, n in levels.items())
            top += _lines(Entry("", f"{words}: --details"))
            break
        top, room = [*top, *more], room - len(more)
    early, late = (sum(part, []) for part in (blocks[:before], blocks[before:]))
    return [*head, *early, *top, *late]


def _whole(entry: Entry) -> bool:
    return entry.heading in WHOLE or entry.text.startswith(COMMAND)


def _lines(entry: Entry, most: int = EACH) -> list[str]:
    """The entry, its text beside its heading, within the columns; a command is never cut."""
    lines = broken(f"{entry.heading:<{INDENT}}{entry.text}", WIDTH, INDENT).split("\n")
    if len(lines) > most and not _whole(entry):
        cut = lines[most - 1]
        whole = cut if len(cut) <= WIDTH - 4 else cut[: WIDTH - 4].rpartition(" ")[0].rstrip()
        lines = [*lines[: most - 1], f"{whole} ..."]
    return lines
