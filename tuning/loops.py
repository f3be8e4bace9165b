"""Frozen loops as the tuner looks at them: matrices in a program, their peaks on the host."""

import abc
from typing import Any

import equinox as eqx
import jax
import numpy as np

from jcontour.analysis.frequency_response import Encoding
from jcontour.analysis.frozen_loops import FrozenLoop
from jcontour.analysis.peak_search import loop_measures
from jcontour.analysis.probes import probe_windows
from jcontour.analysis.sensitivity import LoopPeaks, encoding_of, frozen_family
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant


class Loops(eqx.Module):
    """A way to look at the loops of a controller on a family."""

    @abc.abstractmethod
    def matrices(self, controller: Controller, plants: Plant) -> Any:
        """Arrays from which the peaks follow; traced."""

    @abc.abstractmethod
    def peaks(self, matrices: Any, slopes: Any) -> tuple[LoopPeaks, LoopPeaks]:
        """Peaks, and their derivatives; on the host.

        Args:
            matrices: as NumPy arrays.
            slopes: their derivatives in the weights' coordinates, which come last (..., d).
        """


class ProbedLoops(Loops):
    """Loops frozen at some probes of every contour.

    >>> from jcontour import contours, references
    >>> from jcontour.plants import bridgeport
    >>> from jcontour.simulation.evaluation import stack_plants, stack_references
    >>> machine = bridgeport()
    >>> path, arc = contours.circle(1e-3), 1e-5 * np.arange(9)
    >>> run = references.along(path, arc, machine.dt, preview=5, at_rest=False)
    >>> loops = ProbedLoops.of(stack_plants([machine]), stack_references([run]), count=4)
    >>> loops.windows.position.shape
    (4, 6, 2)

    Args:
        windows: `probe_windows(...)`.
        encoding: how the sensors of the family show positions.
    """

    windows: Reference
    encoding: Encoding

    @classmethod
    def of(cls, plants: Plant, references: Reference, count: int) -> "ProbedLoops":
        """Probes of stacked references, `count` for each."""
        windows = probe_windows(references, count)
        return cls(windows, encoding_of(plants, windows))

    def matrices(self, controller: Controller, plants: Plant) -> FrozenLoop:
        """Frozen loops of every probe and plant."""
        return frozen_family(controller, plants, self.windows)

    def peaks(self, matrices: FrozenLoop, slopes: FrozenLoop) -> tuple[LoopPeaks, LoopPeaks]:
        """Peaks of the sensitivities."""
        values, gradients = loop_measures(matrices, self.encoding)
        change = np.zeros(())
        pairs = zip(jax.tree.leaves(gradients), jax.tree.leaves(slopes), strict=True)
        for gradient, slope in pairs:
            change = change + np.einsum("...mij,...ijd->...md", gradient, slope)
        return LoopPeaks(*np.moveaxis(values, -1, 0)), LoopPeaks(*np.moveaxis(change, -2, 0))
