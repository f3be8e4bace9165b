"""Alter & Tsao 1998: l1 and H-infinity optimal feedforward of a linear-motor drive, Tables 1 to 3.

A stable feedback cancels in the error, so the unstable zeros of the plant decide everything that
was simulated. The zero b is read back from the printed digits. Controllers A and B are not
printed; ours close a loop with an example drive that has the paper's zero.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from experiments.papers.alter_tsao import runs
from experiments.papers.alter_tsao.loops import LoopRun, Perturbed, loop_runs, perturbed_costs
from experiments.papers.alter_tsao.published import BANDWIDTHS_HZ, TABLE_1, TABLE_2
from jcontour.controllers.feedforward.model_following import ModelFollowing
from jcontour.plants.linear_motor_drive import PERIOD

SOURCE = (
    "D. M. Alter, T.-C. Tsao: Control of Linear Motors for Machine Tool Feed Drives: Experimental "
    "Investigation of Optimal Feedforward Tracking Control. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 120 (1998)"
)
HALF_POWER = 2**-0.5  # the printed bandwidths are its; at exactly -3 dB they are 363, 261
FITTED = -0.30746  # fits the printed digits, -0.3075 does not (errata)


@dataclass(frozen=True)
class Settings:
    """Flags of `jcontour reproduce alter-tsao`."""

    quick: bool = False
    """The same: the whole takes seconds."""
    zero: float = FITTED
    """The plant's unstable zero b in lambda."""

    def __post_init__(self):
        if not -1 < self.zero < 0:
            raise ValueError(f"zero: needs a number between -1 and 0, received {self.zero}")


@dataclass(frozen=True)
class Result:
    """The tables, the errors of Figs 3 and 4, and the loops with an example drive."""

    zero: float  # b
    zero_interval: tuple[float, float]  # of b, for which lines 3 to 11 round to the print
    bandwidths_hz: dict[str, float]
    zpetc_apart: float  # from line 28
    trajectory: Float[np.ndarray, " T"]  # one period [m]
    errors: dict[str, Float[np.ndarray, " T"]]  # of Figs 3 and 4 [m]
    table_1: tuple[runs.Line, ...]
    table_2: tuple[runs.Costs, ...]
    line_30: runs.Line30
    loops: tuple[LoopRun, ...]
    perturbed: tuple[Perturbed, ...]


def run(settings: Settings) -> Result:
    """Simulate everything."""
    zero = settings.zero
    thirty, trajectory = runs.line_30(zero), runs.trajectory()
    step, slow = np.array([1.0, -1.0]), np.array([1 + thirty.eps_from_max, -1.0])
    return Result(
        zero=zero,
        zero_interval=runs.zero_interval(),
        bandwidths_hz={
            str(m): ModelFollowing(m, m).bandwidth(PERIOD, HALF_POWER) for m in BANDWIDTHS_HZ
        },
        zpetc_apart=runs.zpetc_apart(zero),
        trajectory=trajectory,
        errors={
            "Fig. 3, controller A: (0, 9, 0)": runs.line_error(TABLE_1[9], zero),
            "Fig. 4, controller B: (0, 9, 0)": runs.periodic_ratio(
                zero**8 * step, slow, trajectory
            ),
        },
        table_1=tuple(runs.line(row, zero) for row in TABLE_1),
        table_2=tuple(runs.costs(row, zero) for row in TABLE_2),
        line_30=thirty,
        loops=loop_runs(zero),
        perturbed=perturbed_costs(zero),
    )
