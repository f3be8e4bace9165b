"""How published statements and numbers fare here: the verdict on each."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from experiments.tables import Table


class Verdict(StrEnum):
    """How a published result fares in simulation."""

    REPRODUCED = "reproduced"
    SAME_ORDERING = "same ordering"
    IN_PART = "in part"
    EXPERIMENTAL = "experimental: shown, not matched"
    NOT_REPRODUCED = "not reproduced"
    UNDECIDED = "undecided: quick run"  # the full run may turn it round


@dataclass(frozen=True)
class Claim:
    """Statement of a paper, and how it fares.

    Attributes:
        item: where the paper says it.
        claim: the statement.
        finding: the same quantity in the simulation.
        verdict: the comparison of the two.
    """

    item: str
    claim: str
    finding: str
    verdict: Verdict


def verdict(holds: bool, partly: bool = False) -> Verdict:
    """Verdict on a statement that holds, holds in part, or does not hold."""
    if holds:
        return Verdict.REPRODUCED
    return Verdict.IN_PART if partly else Verdict.NOT_REPRODUCED


def rounds_to(value: float, printed: str) -> bool:
    """Whether a number rounds to the printed digits; not where it is not finite.

    >>> rounds_to(0.0025145, "2.515e-3"), rounds_to(0.0025144, "2.515e-3")
    (True, False)

    Raises:
        ValueError: what is printed is no number.
    """
    mantissa, mark, exponent = printed.partition("e")
    decimals = len(mantissa.partition(".")[2])
    scaled = value / 10.0 ** int(exponent if mark else 0)
    return abs(scaled - float(mantissa)) <= 0.5 * 10.0**-decimals * (1 + 1e-12)


def statements(claims: Sequence[Claim]) -> Table:
    """The table of the statements."""
    columns = {"where": "item", "the paper": "claim", "the simulation": "finding"}
    return Table("Statements", claims, {**columns, "verdict": "verdict"}, words=4)


def undecided(claims: Sequence[Claim]) -> tuple[Claim, ...]:
    """The same statements without a verdict: the run is too short for one."""
    return tuple(replace(row, verdict=Verdict.UNDECIDED) for row in claims)


def missed(claims: Sequence[Claim]) -> list[str]:
    """Statements that do not hold, or hold in part: a line each with what was found instead."""
    lines = [
        f"  {row.verdict.value}: {row.item}: {row.claim}: here {row.finding}"
        for one in (Verdict.NOT_REPRODUCED, Verdict.IN_PART)
        for row in claims
        if row.verdict is one
    ]
    return ["Not reproduced to the full:", *lines] if lines else []


def tally(claims: Sequence[Claim], quick: bool = False) -> str:
    """Line with the number of statements for each verdict."""
    counts = Counter(row.verdict for row in claims)
    words = "; ".join(f"{counts[one]} {one.value}" for one in Verdict if counts[one])
    run = " of the quick run" if quick else ""
    return f"Verdicts{run} on {len(claims)} statements: {words}."
