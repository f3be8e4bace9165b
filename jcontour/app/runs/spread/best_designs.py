"""The best design of a sweep that keeps the limits of its flags.

Limits on metrics are looked at in the runs of all designs. Limits on loops take an analysis of each
design: they are looked at in the best designs alone, one after the other, until one keeps them.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from jcontour.analysis.frozen_loops import FrozenLoop
from jcontour.analysis.late_loops import delay_margins
from jcontour.analysis.sensitivity import LoopPeaks, frozen_family
from jcontour.analysis.stability import DELAY_SEARCH
from jcontour.app.designs.design import Design, with_values
from jcontour.app.files.results.tuned_result import PathMargins
from jcontour.app.flags.shared import Limited
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.machine import Machine
from jcontour.app.runs.checks.trials import path_margins
from jcontour.app.runs.tuning.family_loops import WINDOWS
from jcontour.app.runs.tuning.limits import counted, loop_limits, noise_limit
from jcontour.simulation.evaluation import stack_plants
from tuning.loops import Looked, ProbedLoops
from tuning.objectives import COUNT_NOISE, LATE

ALIKE = 0.01  # of the least error: what counts of encoders and the places of a grid decide
LOOKED_AT = 100  # designs whose loops are looked at: at most ten seconds for each preview
AT_ONCE = 20  # designs whose loops are made in one program
UNSTABLE = "spectral_radius"

Beyond = dict[str, float]  # limit that is broken -> largest value, SI


class Chosen(NamedTuple):
    """A design of one preview.

    Attributes:
        sample: its index.
        looked: designs whose loops were looked at.
        beyond: limits on loops that it breaks, with what it has; empty unless all that were looked
            at break some.
    """

    sample: int
    looked: int
    beyond: Beyond


def largest_of(dataset: xr.Dataset, metric: str) -> Float[np.ndarray, "P D"]:
    """Largest of a metric over contours and plants of every preview and design, SI."""
    return dataset[metric].values.max(axis=(2, 3))


def within_limits(dataset: xr.Dataset, limits: Mapping[str, float]) -> Bool[np.ndarray, "P D"]:
    """Whether no run of a preview and design diverges or exceeds a limit.

    Args:
        dataset: metrics of a sweep.
        limits: bounds by metric, SI.
    """
    kept = ~dataset.diverged.values.astype(bool).any(axis=(2, 3))
    for metric, bound in limits.items():
        kept &= largest_of(dataset, metric) <= bound
    return kept


def best_design(worst: Float[np.ndarray, " D"], increments: Float[np.ndarray, " D"]) -> int:
    """The design with the calmest control of those whose error is as good as the least.

    Beyond some weights an error hardly falls, and the controls grow.

    >>> best_design(np.array([9.0, 5.04, 5.0, np.inf]), np.array([0.1, 0.5, 0.9, 0.2]))
    1
    """
    alike = worst <= (1 + ALIKE) * worst.min()
    return int(np.argmin(np.where(alike, increments, np.inf)))


def chosen(
    worst: Float[np.ndarray, " D"],
    increments: Float[np.ndarray, " D"],
    look: Callable[[int], Beyond],
) -> Chosen | None:
    """The best design whose loops keep their limits; None where no design is left.

    Where none of the `LOOKED_AT` best ones keeps them, the best one and what it breaks.

    Args:
        worst: errors; infinite for designs that diverge or break a limit on metrics.
        increments: RMS changes of the control.
        look: sample -> limits on loops that it breaks.
    """
    first, left = None, worst.copy()
    for looked in range(1, LOOKED_AT + 1):
        if not np.isfinite(left).any():
            break
        sample = best_design(left, increments)
        beyond = look(sample)
        if not beyond:
            return Chosen(sample, looked, {})
        first = Chosen(sample, 1, beyond) if first is None else first._replace(looked=looked)
        left[sample] = np.inf
    return first


class DesignMargins(NamedTuple):
    """Margins of the frozen loops of many designs, the worst of the probes of each contour.

    Attributes:
        sensitivity: peak Ms; infinite of an unstable loop.
        delay: samples of extra delay that all loops bear; -1 where one is unstable as it is.
    """

    sensitivity: Float[np.ndarray, "D C P"]
    delay: Float[np.ndarray, "D C P"]


class DesignLoops:
    """Frozen loops of the designs with one preview, along the contours of a sweep.

    Args:
        flags: whose limits on loops count.
        design: the controller, its weights open.
        machine: whose smooth family the loops are closed with.
        scenarios: the contours of the sweep, all of them training contours.
    """

    def __init__(self, flags: Limited, design: Design, machine: Machine, scenarios: Scenarios):
        self.limits = loop_limits(flags) | noise_limit(flags, machine, design)
        self._design, self._machine, self._scenarios = design, machine, scenarios
        self._family = stack_plants(machine.smooth_family(design.fed))
        references = jax.device_get(scenarios.references)
        count = counted(self.limits, machine)
        more = flags.min_delay_margin
        self._loops = ProbedLoops.of(self._family, references, WINDOWS, more, count=count)
        self._frozen = eqx.filter_jit(self._matrices)
        self._many = eqx.filter_jit(jax.vmap(self._matrices))

    def beyond(self, varied: dict[str, float]) -> Beyond:
        """Limits that the loops of a design break, with what it has; a radius from 1 on always.

        Args:
            varied: the weights that vary, by name.
        """
        found, peaks = self._look(varied)
        largest = {
            UNSTABLE: float(np.max(peaks.spectral_radius)),
            "peak_sensitivity": float(np.max(peaks.sensitivity)),
        }
        if found.late is not None:
            largest[LATE] = float(np.max(found.late))
        if found.count_noise is not None:
            largest[COUNT_NOISE] = float(np.max(found.count_noise))
        if not largest[UNSTABLE] < 1:
            return {UNSTABLE: largest[UNSTABLE]}
        return {
            name: largest[name] for name, bound in self.limits.items() if not largest[name] <= bound
        }

    def margins(self, varied: dict[str, float]) -> PathMargins:
        """Margins of a design, as `jcontour tune` tells them."""
        design, (_, peaks) = self._design, self._look(varied)
        controller = design.build(with_values(design.start, varied))
        return path_margins(controller, self._machine, self._scenarios, design.fed, peaks)

    def of_all(self, varied: dict[str, Float[np.ndarray, " D"]]) -> DesignMargins:
        """Ms and delay margins of many designs, of which `AT_ONCE` are looked at together."""
        count, plants = len(next(iter(varied.values()))), len(self._machine.family_names)
        contours = len(self._scenarios.jobs)
        found = []
        for first in range(0, count, AT_ONCE):
            # always as many, the last one again and again: one program
            rows = np.minimum(np.arange(first, first + AT_ONCE), count - 1)
            designs = {name: np.asarray(column, float)[rows] for name, column in varied.items()}
            matrices = jax.device_get(self._many(designs))
            kept = min(AT_ONCE, count - first)
            loops = jax.tree.map(
                lambda leaf, kept=kept: leaf[:kept].reshape(-1, *leaf.shape[2:]), matrices
            )
            peaks = _looked(replace(self._loops, more=0, count=None), loops).peaks
            assert peaks is not None  # they always are
            margins = delay_margins(loops, DELAY_SEARCH)
            shape = (kept, contours, WINDOWS, plants)
            found.append(
                (peaks.sensitivity.reshape(shape).max(axis=2), margins.reshape(shape).min(axis=2))
            )
        return DesignMargins(
            *(np.concatenate(parts).astype(float) for parts in zip(*found, strict=True))
        )

    def _look(self, varied: dict[str, float]) -> tuple[Looked, LoopPeaks]:
        numbers = {name: np.asarray(value, float) for name, value in varied.items()}
        matrices = jax.device_get(self._frozen(numbers))
        looked = _looked(self._loops, matrices)
        assert looked.peaks is not None  # they always are
        return looked, looked.peaks

    def _matrices(self, varied: dict[str, Any]):
        controller = self._design.build(with_values(self._design.start, varied))
        return frozen_family(self._family, controller, self._loops.windows)


def _looked(loops: ProbedLoops, matrices: FrozenLoop) -> Looked:
    """What is seen of frozen loops, without slopes."""
    still = jax.tree.map(lambda leaf: np.zeros((*leaf.shape, 0)), matrices)
    return loops.look(matrices, still)[0]
