"""Advice on another tolerance of a jerk-limited motion, with what it buys: it has been planned."""

from collections.abc import Callable

import numpy as np

from jcontour.app.jobs.coarse import Coarse
from jcontour.app.jobs.motion_laws import UM
from jcontour.motion.cornering import Planned, limit_shares

ENOUGH = 0.1  # of the cycle time under the limit of the tolerance: less is worth no other plan
STEPS = (1.0, 2.0, 5.0, 10.0)  # of tolerances that are tried, in each decade
SAVES = 1e-3  # of the cycle time: less is no time


def tolerance_advice(
    planned: Planned,
    used: float,
    allowed: float | None,
    coarse: Coarse | None,
    within: Callable[[float], Planned],
) -> tuple[str, ...]:
    """Words on one other tolerance: the program's own, that of its coordinates, or the next step.

    Args:
        planned: the motion.
        used: tolerance that it is within [m].
        allowed: what the program allows from its path [m]; None where it does not say.
        coarse: rounding of the coordinates that spoils the motion; None where none does.
        within: plans the motion within another tolerance [m].
    """
    if allowed is not None and not np.isclose(allowed, used):
        return (_own(planned, used, allowed, within(allowed)),)
    if not used:
        return ()
    if coarse is not None:
        rounded = (
            f"coordinates are rounded to {_um(coarse.step)}, the tolerance is {_um(used)}: "
            f"{coarse.moves} short moves cannot be smoothed"
        )
        tried = within(coarse.step)
        if not _saves(planned, tried):
            return ()
        more = "coordinates with more digits need not leave the part"
        return (f"{rounded}; {_buys(planned, tried, coarse.step)}; {more}",)
    share = limit_shares(planned)["tolerance"]
    if share < ENOUGH:
        return ()
    step = next_step(used)
    limits = f"the tolerance of {_um(used)} limits {100 * share:.0f} % of the time"
    return (f"{limits}: {_buys(planned, within(step), step)}",)


def next_step(tolerance: float) -> float:
    """The next larger tolerance of 1, 2, 5, 10, ... um [m].

    >>> [round(1e6 * next_step(1e-6 * um)) for um in (1.5, 2.0, 3.0, 5.0, 99.0)]
    [2, 5, 5, 10, 100]
    """
    um = tolerance / UM * (1 + 1e-9)
    decade = 10.0 ** np.floor(np.log10(um))
    return UM * decade * next(step for step in STEPS if decade * step > um)


def _own(planned: Planned, used: float, allowed: float, tried: Planned) -> str:
    """The program's own tolerance, which is not used by itself, and what it would buy."""
    own = f"{_um(allowed)} (P of G64)"
    if allowed < used:
        closer = f"closer than the {_um(used)} that are used"
        return f"the program asks for {own}, {closer}: {_buys(planned, tried, allowed)}"
    begun = f"the program allows {own}, {_um(used)} are used"
    if not _saves(planned, tried):
        return f"{begun}: more would save no time"
    return f"{begun}: {_buys(planned, tried, allowed)}"


def _saves(planned: Planned, tried: Planned) -> bool:
    return tried.duration < (1 - SAVES) * planned.duration


def _buys(planned: Planned, tried: Planned, tolerance: float) -> str:
    """Flag of a tolerance, its cycle time, and how near it stays to the program."""
    times = f"{tried.duration:.3f} s, not {planned.duration:.3f} s"
    near = f"within {1e6 * tried.around.deviation:.3g} um of the program"
    return f"--corner-tolerance-um {tolerance / UM:.4g} takes {times}, {near}"


def _um(tolerance: float) -> str:
    return f"{tolerance / UM:.4g} um"
