"""Tomizuka, Hu, Chiu & Kamano 1990: two axes kept together by adaptive feedforward.

The paper prints neither a plant nor gains. All numbers are of axes that we chose; only its
statements can be reproduced.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

from experiments.papers.synchronisation.claims import FAST, SLOW, claims
from experiments.papers.synchronisation.figures import draw
from experiments.papers.synchronisation.result import CONTINUOUS, Result
from experiments.papers.synchronisation.runs import (
    NOMINAL,
    PLANTS,
    UNEQUAL,
    WEAK,
    bounds,
    scored,
    stepped,
)
from experiments.papers.synchronisation.tables import show

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = (
    "M. Tomizuka, J.-S. Hu, T.-C. Chiu, T. Kamano: Synchronization of Two Motion Control Axes "
    "Under Adaptive Feedforward Control. ASME Winter Annual Meeting (1990)"
)
PUBLISHED = ()  # its figures have no numbers in print
BETAS = {  # plant, period [ms] -> couplings
    (NOMINAL, CONTINUOUS): (0.0, 1.0, 2.0, 5.0, 10.0),
    (NOMINAL, FAST): (0.0, 1.0, 2.0, 3.0, 5.0, 10.0),
    (NOMINAL, SLOW): (0.0, 1.0, 2.0, 3.0, 3.5, 4.0),
    (WEAK, CONTINUOUS): (0.0, 5.0),
    (WEAK, SLOW): (0.0, 1.0, 3.0, 3.7, 4.0),
    (UNEQUAL, CONTINUOUS): (0.0, 1.0, 5.0),
    (UNEQUAL, FAST): (0.0, 1.0, 5.0),
}
INSTANTS, QUICK_INSTANTS = 2401, 601  # of a continuous response


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce synchronisation`."""

    quick: bool = False
    """A quarter of the instants of the continuous responses."""


def run(settings: Settings, folder: Path) -> Result:
    """Simulate everything; nothing is written to the folder."""
    samples = QUICK_INSTANTS if settings.quick else INSTANTS
    curves = tuple(
        stepped(PLANTS[name], period_ms, beta, name, samples)
        for (name, period_ms), betas in BETAS.items()
        for beta in betas
    )
    sampled = [(name, period) for name, period in BETAS if period != CONTINUOUS]
    found = Result(
        source=SOURCE,
        settings=asdict(settings),
        rows=tuple(scored(curve) for curve in curves),
        bounds=tuple(bounds(name, period) for name, period in sampled),
        curves=curves,
    )
    return replace(found, claims=claims(found))
