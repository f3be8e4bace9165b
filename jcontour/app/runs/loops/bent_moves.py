"""Moves along a bent reference, section by section of the program that it comes from."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jcontour.app.files.bent_reference import Moves, moves_through
from jcontour.app.jobs.sections import Section


def moves_along(
    position: Float[np.ndarray, "T m"], dt: float, run: Sequence[Section], source: str
) -> list[Moves]:
    """Moves of every section of a run; each begins where the one before ends.

    Args:
        position: samples of the run [m].
        dt: sample period [s].
        run: its sections.
        source: name of the program that the run comes from.
    """
    found, place = [], position[0]
    for section in run:
        if section.rapid:
            at = [section.first, *section.corners, section.last]
            moves = Moves(position[at], np.diff(at) * dt, 0.0, rapid=True)
        else:
            rows = position[section.first : section.last + 1].copy()
            rows[0] = place
            moves = moves_through(rows, dt)
        found.append(moves._replace(asked=_asked(section, source)))
        place = moves.ends[-1]
    return found


def _asked(section: Section, source: str) -> str:
    """What is to be done before a section, in words."""
    by_line: dict[int, list[str]] = {}
    for line, words in section.asked:
        by_line.setdefault(line, []).append(words)
    told = [f"line {line}: {', '.join(words)}" for line, words in by_line.items()]
    return f"{source}, {'; '.join(told)}" if told else ""
