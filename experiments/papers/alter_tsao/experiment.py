"""Alter & Tsao 1998: l1 and H-infinity optimal feedforward of a linear-motor drive, Tables 1 to 3.

A stable feedback cancels in the error, so the unstable zeros of the plant decide everything that
was simulated. The zero b is read back from the printed digits. Controllers A and B are not
printed; ours close a loop with an example drive that has the paper's zero.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from experiments.papers.alter_tsao.claims import claims
from experiments.papers.alter_tsao.figures import draw
from experiments.papers.alter_tsao.loops import loop_runs, perturbed_costs
from experiments.papers.alter_tsao.published import BANDWIDTHS_HZ, TABLE_1, TABLE_2, TABLE_3
from experiments.papers.alter_tsao.result import Result
from experiments.papers.alter_tsao.runs import (
    line_30,
    line_error,
    periodic_ratio,
    table_1,
    table_2,
    trajectory,
    zero_interval,
    zpetc_apart,
)
from experiments.papers.alter_tsao.tables import show
from jcontour.controllers.feedforward.model_following import ModelFollowing
from jcontour.plants.linear_motor_drive import PERIOD

__all__ = ["PUBLISHED", "SOURCE", "Settings", "draw", "run", "show"]

SOURCE = (
    "D. M. Alter, T.-C. Tsao: Control of Linear Motors for Machine Tool Feed Drives: Experimental "
    "Investigation of Optimal Feedforward Tracking Control. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 120 (1998)"
)
PUBLISHED = (*TABLE_1, *TABLE_2, *TABLE_3)
HALF_POWER = 2**-0.5  # the printed bandwidths are its; at exactly -3 dB they are 363, 261
FITTED = -0.30746  # fits the printed digits, -0.3075 does not (errata)


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce alter-tsao`."""

    quick: bool = False
    """Leave out the loops and the costs over eps: the tables alone."""
    zero: float = FITTED
    """The plant's unstable zero b in lambda."""

    def __post_init__(self):
        if not -1 < self.zero < 0:
            raise ValueError(f"zero: needs a number between -1 and 0, received {self.zero}")


def run(settings: Settings, folder: Path) -> Result:
    """Simulate everything; nothing is written to the folder."""
    zero = settings.zero
    thirty = line_30(zero)
    step, slow = np.array([1.0, -1.0]), np.array([1 + thirty.eps_from_max, -1.0])
    errors = {
        "Fig. 3, controller A: (0, 9, 0)": line_error(TABLE_1[9], zero),
        "Fig. 4, controller B: (0, 9, 0)": periodic_ratio(zero**8 * step, slow, trajectory()),
    }
    orders = {str(m): ModelFollowing(m, m).bandwidth(PERIOD, HALF_POWER) for m in BANDWIDTHS_HZ}
    found = Result(
        source=SOURCE,
        settings=asdict(settings),
        zero_interval=zero_interval(),
        bandwidths_hz=orders,
        zpetc_apart=zpetc_apart(zero),
        trajectory=trajectory(),
        errors=errors,
        table_1=table_1(zero),
        table_2=table_2(TABLE_2, zero),
        line_30=thirty,
        loops=() if settings.quick else loop_runs(zero),
        perturbed=() if settings.quick else perturbed_costs(zero),
    )
    return replace(found, claims=claims(found))
