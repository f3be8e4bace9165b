"""Runs along one contour, as figures draw them: signals in SI units, and which samples count."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jcontour.motion.references import Reference
from jcontour.simulation.closed_loop import Rollout
from jcontour.simulation.metrics import contour_error

NOMINAL = "nominal plant"


@dataclass(frozen=True)
class DrawnRun:
    """Signals of one run.

    Attributes:
        label: of the controller or its weights; it chooses the colour.
        plant: it ran on, in words.
        output: (T, m) [m].
        control: (T, p) [control unit].
        contour_error: (T, m) [m], from the nearest point of the contour to the tool.
        diverged: its error means nothing.
    """

    label: str
    plant: str
    output: np.ndarray
    control: np.ndarray
    contour_error: np.ndarray
    diverged: bool = False


@dataclass(frozen=True)
class ContourRuns:
    """Runs along one contour.

    Attributes:
        name: of the contour.
        time: (T,) [s].
        scored: (T,) which samples count.
        reference: (T, m) [m].
        axes: names of the m axes.
        control_unit: for labels.
        rows: runs to compare with each other, such as those on the nominal plant.
    """

    name: str
    time: np.ndarray
    scored: np.ndarray
    reference: np.ndarray
    axes: tuple[str, ...]
    control_unit: str
    rows: tuple[tuple[DrawnRun, ...], ...]

    @classmethod
    def of(
        cls,
        reference: Reference,
        rollouts: Mapping[str, Rollout],
        name: str = "contour",
        axes: Sequence[str] = "XYZ",
        control_unit: str = "control unit",
    ) -> "ContourRuns":
        """Rollouts by their labels, along one reference."""
        steps = reference.steps
        runs = []
        for label, rollout in rollouts.items():
            error = np.asarray(contour_error(rollout.output, reference))
            output, control = np.asarray(rollout.output), np.asarray(rollout.control)
            runs.append(DrawnRun(label, NOMINAL, output, control, error))
        position = np.asarray(reference.position)[:steps]
        return cls(
            name,
            reference.dt * np.arange(steps),
            np.asarray(reference.mask)[:steps],
            position,
            tuple(axes)[: position.shape[1]],
            control_unit,
            (tuple(runs),),
        )

    @property
    def runs(self) -> list[DrawnRun]:
        """All of them."""
        return [run for row in self.rows for run in row]

    @property
    def rapids(self) -> bool:
        """Whether moves between scored ones do not count."""
        first, last = np.flatnonzero(self.scored)[[0, -1]]
        return not self.scored[first : last + 1].all()

    def shown(self, signal: np.ndarray) -> np.ndarray:
        """A signal (T, ...) with NaN where samples do not count."""
        scored = self.scored.reshape(-1, *(1,) * (signal.ndim - 1))
        return np.where(scored, signal, np.nan)
