"""How published statements and numbers fare here: the verdict on each."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

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
    """Statement of a paper, and how it fares."""

    item: str  # where the paper says it
    claim: str  # the statement
    finding: str  # the same quantity in the simulation
    verdict: Verdict  # the comparison of the two


def verdict(holds: bool, partly: bool = False) -> Verdict:
    """Verdict on a statement that holds, holds in part, or does not hold."""
    if holds:
        return Verdict.REPRODUCED
    return Verdict.IN_PART if partly else Verdict.NOT_REPRODUCED


def in_order(holds: bool) -> Verdict:
    """Verdict on an order of numbers whose sizes are not compared."""
    return Verdict.SAME_ORDERING if holds else Verdict.NOT_REPRODUCED


def on_all(holds: Iterable[bool]) -> Verdict:
    """Verdict on several cases: in part where it holds for some."""
    cases = list(holds)
    return verdict(all(cases), any(cases))


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


def falls(values: Sequence[float] | np.ndarray) -> bool:
    """Whether each value is below the one before; a diverged run (infinite) does not fall."""
    return bool(np.all(np.isfinite(values)) and np.all(np.diff(values) < 0))


def listed(values: Iterable[float], digits: int = 3) -> str:
    """Values to some digits, with commas."""
    return ", ".join(f"{value:.{digits}g}" for value in values)


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
