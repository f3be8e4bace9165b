"""Frozen loops as the tuner looks at them: matrices in a program, their peaks on the host."""

import abc
from hashlib import blake2b
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from jcontour.analysis.count_noise import count_noise
from jcontour.analysis.frequency_response import Encoding
from jcontour.analysis.frozen_loops import FrozenLoop
from jcontour.analysis.peak_search import loop_measures
from jcontour.analysis.sensitivity import LoopPeaks, encoding_of, frozen_family, probe_windows
from jcontour.analysis.stability import late_measures
from jcontour.analysis.uncertain_loops import ResponseUncertainty
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.plants.encoders import fixed


class Looked(NamedTuple):
    """Peaks and radii of frozen loops, or their derivatives in the coordinates, which come last."""

    loops: LoopPeaks | None = None  # of the sensitivities; None where the loops are not looked at
    late: Any = None  # spectral radius with more delay; None where it is not looked at
    count_noise: Any = None  # RMS of the control by the counts of encoders; likewise


class Loops(eqx.Module):
    """A way to look at the loops of a controller on a family."""

    @abc.abstractmethod
    def matrices(self, plants: Plant, controller: Controller) -> Any:
        """Arrays from which the peaks follow; traced."""

    @abc.abstractmethod
    def look(self, matrices: Any, slopes: Any) -> tuple[Looked, Looked]:
        """What is seen, and its derivatives; on the host.

        Args:
            matrices: as NumPy arrays.
            slopes: their derivatives in the weights' coordinates, which come last (..., d).
        """


def _fixed(count: float | Float[np.ndarray, " r"] | None) -> float | tuple[float, ...] | None:
    """As a field that a program is compiled for."""
    return None if count is None else fixed(count)


class ProbedLoops(Loops):
    """Loops frozen at some probes of every contour.

    >>> from jcontour import contours, references
    >>> from jcontour.plants import bridgeport
    >>> from jcontour.simulation.evaluation import stack_plants, stack_references
    >>> machine = bridgeport()
    >>> path, arc = contours.circle(1e-3), 1e-5 * np.arange(9)
    >>> run = references.along(path, arc, machine.dt, preview=5, at_rest=False)
    >>> loops = ProbedLoops.of(stack_plants([machine]), stack_references([run]), probes=4)
    >>> loops.windows.position.shape
    (4, 6, 2)

    Args:
        windows: `probe_windows(...)`.
        encoding: how the sensors of the family show positions.
        more: samples of delay that the loops are looked at with as well; none for 0.
        uncertainty: how far off the response of the plants may be; nothing is said of it for None.
        count: length of a count of the encoders [m], one number or one for each position (r,); None
            where its noise is not looked at.
    """

    windows: Reference
    encoding: Encoding
    more: int = eqx.field(static=True, default=0)
    uncertainty: ResponseUncertainty | None = None
    count: float | tuple[float, ...] | None = eqx.field(static=True, default=None, converter=_fixed)

    @classmethod
    def of(
        cls,
        plants: Plant,
        references: Reference,
        probes: int,
        more: int = 0,
        uncertainty: ResponseUncertainty | None = None,
        count: float | Float[np.ndarray, " r"] | None = None,
    ) -> "ProbedLoops":
        """Some probes of each of the stacked references."""
        windows = probe_windows(references, probes)
        return cls(windows, encoding_of(plants, windows), more, uncertainty, count)

    def matrices(self, plants: Plant, controller: Controller) -> FrozenLoop:
        """Frozen loops of every probe and plant."""
        return frozen_family(plants, controller, self.windows)

    def look(self, matrices: FrozenLoop, slopes: FrozenLoop) -> tuple[Looked, Looked]:
        """Peaks of the sensitivities, the radius with more delay, and the noise of the counts.

        Probes whose loops are the same, as those of a controller that never changes, are looked at
        once.
        """
        once, alike = _different(matrices, slopes)
        looked = self._look(*_probes((matrices, slopes), once))
        return _probes(looked, alike)

    def _look(self, matrices: FrozenLoop, slopes: FrozenLoop) -> tuple[Looked, Looked]:
        values, gradients = loop_measures(matrices, self.encoding, self.uncertainty)
        change = _along(gradients, slopes, "...mij,...ijd->...md")
        looked = [LoopPeaks(*np.moveaxis(values, -1, 0)), None, None]
        moved = [LoopPeaks(*np.moveaxis(change, -2, 0)), None, None]
        if self.more:
            looked[1], gradient = late_measures(matrices, self.more)
            moved[1] = _along(gradient, slopes, "...ij,...ijd->...d")
        if self.count is not None:
            deviation = np.asarray(self.count) / np.sqrt(12)
            looked[2], gradient = count_noise(matrices, self.encoding, deviation)
            moved[2] = _along(gradient, slopes, "...ij,...ijd->...d")
        return Looked(*looked), Looked(*moved)


def _different(matrices: FrozenLoop, slopes: FrozenLoop) -> tuple[list[int], list[int]]:
    """Probes that differ, and for every probe the place of its like among them."""
    leaves = jax.tree.leaves((matrices, slopes))
    seen: dict[bytes, int] = {}
    once, alike = [], []
    for probe in range(len(leaves[0])):
        digest = blake2b()
        for leaf in leaves:
            digest.update(np.asarray(leaf[probe]).tobytes())
        place = seen.setdefault(digest.digest(), len(seen))
        if place == len(once):
            once.append(probe)
        alike.append(place)
    return once, alike


def _probes(tree: Any, places: list[int]) -> Any:
    """Some probes, in this order; a copy only where that is not all of them."""
    return jax.tree.map(
        lambda leaf: leaf if places == list(range(len(leaf))) else leaf[places], tree
    )


def _along(gradients: FrozenLoop, slopes: FrozenLoop, letters: str) -> np.ndarray:
    """Derivatives in the weights' coordinates."""
    change = np.zeros(())
    for gradient, slope in zip(jax.tree.leaves(gradients), jax.tree.leaves(slopes), strict=True):
        change = change + np.einsum(letters, gradient, slope)
    return change
