"""Result of the reproduction of Yuan's contouring controllers."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.papers.verdicts import Claim

CEBC1, CEBC2 = "CEBC-1", "CEBC-2"  # by bounded tracking errors; by the contour error itself
ATTACKED, RANDOM, FRICTION = "worst", "random", "friction"  # what acts, the first two 0.5 A
GANTRY, TWIN, GUIDES = "gantry", "MuJoCo", "guides"  # smooth; smooth; with stick and slip
EVERY, FOUR, ONE = "every sample", "four places", "one place"  # where models are taken


@dataclass(frozen=True)
class Polygons:
    """Algorithm 2 for R = 80 mm and 4 mm.

    Attributes:
        inner: sides n_in.
        outer: sides n_out.
        printed_side_mm: l_side of the outer polygon with the 10 sides that are printed.
        side_mm: l_side of ours.
        radius_mm: of the contour.
    """

    inner: int
    outer: int
    printed_side_mm: float
    side_mm: float
    radius_mm: float


@dataclass(frozen=True)
class LoopRow:
    """Run of a controller along Fig. 5.11.

    Attributes:
        name: of the controller.
        models: that it has.
        machine: that it drives.
        acting: what disturbs the machine.
        states: of the model, currents that wait for a late drive among them.
        length: samples N of a plan.
        promised_um: largest contour error that the certificate allows.
        reached_um: largest contour error of the run.
        promised_axes_um: largest tracking error of the tool along X and Y; None where no
            controller keeps it.
        reached_axes_um: of the run.
        promised_twist_urad: largest |theta|.
        reached_twist_urad: of the run.
        remainder_a: what the model error amounts to at most, in the current of a motor that does
            as much to the same state.
        closed: share of the model error's box that the tube needs; proven where at most one.
        motor_share: largest disturbance of a motor in the run over its box.
        remainder_share: largest model error in the run over its box.
        current_a: largest current.
        active: share of the samples in which a limit was active.
        unsolved: QPs without an answer.
        median_ms: processor time of a step of all controllers, building and solving.
        slowest_ms: the same, of the slowest step.
        samples: of the run.
        diverged: whether the run ended far from the path.
        contour_error_um: (T,).
    """

    name: str
    models: str
    machine: str
    acting: str
    states: int
    length: int
    promised_um: float
    reached_um: float
    promised_axes_um: tuple[float, float] | None
    reached_axes_um: tuple[float, float]
    promised_twist_urad: float
    reached_twist_urad: float
    remainder_a: float
    closed: float
    motor_share: float
    remainder_share: float
    current_a: float
    active: float
    unsolved: int
    median_ms: float
    slowest_ms: float
    samples: int
    diverged: bool
    contour_error_um: Float[np.ndarray, " T"]

    @property
    def late(self) -> bool:
        """Whether the drives act one sample late."""
        return self.states > 6

    @property
    def label(self) -> str:
        """The controller and its models."""
        return f"{self.name}, {self.models}"

    @property
    def place(self) -> str:
        """The machine and what acts on it."""
        return f"{self.machine}{' late' * self.late}, {self.acting}"

    @property
    def kept(self) -> bool:
        """Whether the run stayed within its certificate, every QP solved, the tube proven."""
        within = self.reached_um <= self.promised_um and not self.diverged
        return within and self.unsolved == 0 and self.closed <= 1


@dataclass(frozen=True)
class Result:
    """Everything that is computed."""

    source: str
    settings: dict[str, Any]
    polygons: Polygons
    loops: tuple[LoopRow, ...]
    claims: tuple[Claim, ...] = ()

    def loop(self, name: str, models: str, late: bool = False) -> LoopRow | None:
        """The run of a controller on the library's gantry; None where a quick run has none."""
        wanted = (name, models, GANTRY, ATTACKED, late)
        for row in self.loops:
            if (row.name, row.models, row.machine, row.acting, row.late) == wanted:
                return row
        return None
