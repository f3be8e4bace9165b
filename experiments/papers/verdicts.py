"""How a published result fares here."""

from enum import StrEnum


class Verdict(StrEnum):
    """How a published result fares in simulation."""

    REPRODUCED = "reproduced"
    SAME_ORDERING = "same ordering"
    EXPERIMENTAL = "experimental: shown, not matched"
    NOT_REPRODUCED = "not reproduced"
