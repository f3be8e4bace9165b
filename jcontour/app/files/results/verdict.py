"""Verdict of a command: whether its values may be loaded, every reason against it, every limit.

One rule for all commands: every stated limit is kept, or the verdict names it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from jcontour.app.plain_numbers import MM_PER_MIN, feed_number, feed_words

NOT_TO_USE = 3  # exit code of a command whose verdict is against its values
ROUNDING = 1e-5  # relative: a search ends at its limits to within rounding
NEAR = 0.9  # of a limit, from which on there is a warning
RINGING = 0.1  # of a limit, from which on a part between samples is printed


Level = Literal["reason", "limit", "warning"]


@dataclass(frozen=True)
class Message:
    """A finding for whoever may load the values of a run."""

    level: Level  # a reason against them, a limit that is not kept, or what to know before
    text: str  # the finding with its numbers
    remedy: str = ""  # what helps; empty where nothing is known to

    @property
    def line(self) -> str:
        """Finding and remedy in one line."""
        return f"{self.text}: {self.remedy}" if self.remedy else self.text


def reason(text: str, remedy: str = "") -> Message:
    """A reason against the values."""
    return Message("reason", text, remedy)


def warning(text: str, remedy: str = "") -> Message:
    """What to know before the values are loaded."""
    return Message("warning", text, remedy)


@dataclass(frozen=True, kw_only=True)
class LimitCheck:
    """A stated limit and the largest value that the runs reach."""

    name: str  # of the quantity, with its axis or input, as "speed of X"
    value: float  # the largest, in `unit`; infinite where a loop is unstable
    allowed: float  # the limit
    unit: str = ""  # of both; empty of a ratio
    member: str = ""  # contour and plant of the largest value
    between: float = 0.0  # part of the value that is between the samples
    # relative; a value beyond the limit by no more counts as kept: rounding, counts, or a loop's
    # overshoot of a motion that keeps the limit
    slack: float = ROUNDING
    saturated: float = 0.0  # share of the samples at which a control is at this limit

    @property
    def kept(self) -> bool:
        """Whether the value is within the limit; a value that is not a number is not."""
        return bool(self.value <= (1 + self.slack) * self.allowed)

    @property
    def near(self) -> bool:
        """Within the limit by less than a tenth, or beyond it by no more than the slack."""
        return self.kept and self.value >= NEAR * self.allowed

    @property
    def shown(self) -> float:
        """The value as it is printed: a speed in mm/min, as programs have feeds."""
        return self.value / MM_PER_MIN if self.unit == "m/s" else self.value

    @property
    def size(self) -> str:
        """Value and limit with their unit, as they are printed."""
        if self.unit == "m/s":
            return f"{feed_number(self.value)} of {feed_words(self.allowed)}"
        return f"{self.value:.4g} of {self.allowed:.4g} {self.unit}".rstrip()

    @property
    def line(self) -> str:
        """The limit in words, where it is near or exceeded."""
        how = "is near its limit" if self.kept else "EXCEEDS its limit"
        if self.kept and self.saturated:
            how = f"SATURATES at {100 * self.saturated:.3g} % of the samples"
        if self.kept and self.value > (1 + ROUNDING) * self.allowed:
            how = f"overshoots its limit, by less than {100 * self.slack:g} %"
        line = f"{self.name} {how}: {self.size}"
        if self.between > RINGING * self.allowed:
            line += f", {self.between:.3g} of it between samples: the control alternates"
        return f"{line} ({self.member})" if self.member else line


def exceeded(limits: Sequence[LimitCheck]) -> list[str]:
    """A line for every limit that is not kept."""
    return [one.line for one in limits if not one.kept]


def kept_words(limits: Sequence[LimitCheck]) -> str:
    """Heading of a verdict that tests a loop and does not recommend it."""
    if not limits:
        return "The machine states no limit."
    saturated = any(one.saturated for one in limits)
    return f"Every stated limit is kept{'; a control SATURATES' if saturated else ''}."


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether the values of a run may be loaded; `Verdict.of` makes it."""

    usable: bool  # every stated limit is kept, and no reason speaks against the values
    heading: str  # yes or no, in words
    # reasons, limits that are not kept, and warnings, each level in its order
    messages: list[Message]
    limits: list[LimitCheck]  # every stated limit

    @classmethod
    def of(
        cls,
        limits: Sequence[LimitCheck],
        messages: Sequence[Message] = (),
        limit_remedies: Sequence[str] = (),
        passed: str = "USE THESE VALUES",
    ) -> "Verdict":
        """Verdict of stated limits and further findings.

        Args:
            limits: every stated limit, with what the runs reach; those that are near become
                warnings.
            messages: further findings, the gravest first.
            limit_remedies: what helps where a limit is not kept.
            passed: heading where nothing speaks against the values.
        """
        beyond = [Message("limit", line) for line in exceeded(limits)]
        if beyond:
            beyond += [Message("limit", line) for line in limit_remedies]
        against = [*(one for one in messages if one.level != "warning"), *beyond]
        near = [warning(one.line) for one in limits if one.near]
        refused = f"DO NOT {passed}" if passed.startswith("USE") else "DO NOT USE"
        return cls(
            usable=not against,
            heading=refused if against else passed,
            messages=[*against, *(one for one in messages if one.level == "warning"), *near],
            limits=list(limits),
        )

    @property
    def reasons(self) -> list[str]:
        """Lines against the values, limits that are not kept last."""
        return [one.line for one in self.messages if one.level != "warning"]

    @property
    def warnings(self) -> list[str]:
        """Lines to know before the values are loaded."""
        return [one.line for one in self.messages if one.level == "warning"]

    @property
    def exit_code(self) -> int:
        """Exit code of the command."""
        return 0 if self.usable else NOT_TO_USE

    @property
    def lines(self) -> list[str]:
        """Heading, reasons and warnings, as terminal and page show them."""
        return [
            self.heading,
            *(f"  because: {line}" for line in self.reasons),
            *(f"WARNING: {line}" for line in self.warnings),
        ]
