"""The largest errors and controls of a family on many contours, under bounded disturbances.

Matrices of all loops in one program; the worst samples and their attacks on the host; the slopes
are those of runs under these attacks, in a third program.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import ArrayLike, Float

from jcontour.analysis.frozen_loops import unlimited
from jcontour.bounds.attacks import Attack
from jcontour.bounds.distance import LeavesContour
from jcontour.bounds.disturbed_loop import Box, DisturbedLoop, loop_along
from jcontour.bounds.worst_cases import PeakValues, WorstCase, attacked_peaks, worst_case
from jcontour.controller import Controller, Plan
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import member, platform_batching


class DisturbedFamily(eqx.Module):
    """A family of plants, and bounds of what acts on each of them.

    Attributes:
        plants: the family, stacked; linear, without sensors that count.
        force: on every control.
        noise: on every measured number, in its own unit: a position [m], a speed [m/s].
        limit: of every control; infinite where there is none.
    """

    plants: Plant
    force: Float[ArrayLike, " p"]
    noise: Float[ArrayLike, " q"]
    limit: Float[ArrayLike, " p"]

    def loops(self, controller: Controller, references: Reference) -> DisturbedLoop:
        """Matrices of the loops along their runs, axes (contour, plant); traceable."""
        return self._everywhere(loop_along, controller, references)

    def worst(
        self, loops: DisturbedLoop, references: Reference, window: tuple[int, int] | None
    ) -> tuple[PeakValues, WorstCase]:
        """Largest errors and controls (contour, plant), and what makes them; on the host.

        A run that leaves its contour has infinite ones. Loops that would not be stable for ever
        have those of their run.
        """
        box, limit = Box(np.asarray(self.force), np.asarray(self.noise)), np.asarray(self.limit)
        references, (count, plants) = jax.device_get(references), loops.E.shape[:2]
        found = [
            [
                _worst(member(member(loops, c), p), member(references, c), box, limit, window)
                for p in range(plants)
            ]
            for c in range(count)
        ]
        rows = [jax.tree.map(lambda *leaves: np.stack(leaves), *row) for row in found]
        return jax.tree.map(lambda *leaves: np.stack(leaves), *rows)

    def attacked(
        self, controller: Controller, references: Reference, worst: WorstCase
    ) -> PeakValues:
        """Errors and controls under the attacks (contour, plant); traceable."""

        def at(plant, controller, plan, reference, worst):
            return attacked_peaks(plant, controller, plan, reference, worst, self.limit)

        return self._everywhere(at, controller, references, worst)

    def _everywhere(
        self,
        function: Callable[..., Any],
        controller: Controller,
        references: Reference,
        *batches: Any,
    ) -> Any:
        """A function of plant, controller, plan, reference, and a member of every batch."""
        controller, plants = unlimited(controller), unlimited(self.plants)

        def on_contour(row):
            reference, *batches = row
            plan: Plan = controller.prepare(reference)

            def on_plant(plant, *batches):
                return function(plant, controller, plan, reference, *batches)

            return jax.vmap(on_plant)(plants, *batches)

        return platform_batching()(on_contour, (references, *batches))


def _worst(
    loop: DisturbedLoop,
    reference: Reference,
    box: Box,
    limit: np.ndarray,
    window: tuple[int, int] | None,
) -> tuple[PeakValues, WorstCase]:
    try:
        return worst_case(loop, reference, box, limit, window)
    except LeavesContour:
        return PeakValues(np.array(np.inf), np.array(np.inf)), _nothing(loop)


def _nothing(loop: DisturbedLoop) -> WorstCase:
    """A worst case without attacks, in the place of one that there is none of."""
    (T, m), (p, q) = loop.output.shape, loop.D.shape[1:]
    still = Attack(np.zeros((T, p)), np.zeros((T, q)))
    error = Attack(*(np.zeros((m, *leaf.shape)) for leaf in still))
    first = np.array(0)
    return WorstCase(first, np.array(0.0), np.eye(m)[1:], error, still, first, first)
