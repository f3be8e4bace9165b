"""The best design of every preview of a sweep, within the limits of its flags.

Limits on metrics are looked at in the runs of all designs. Limits on loops take an analysis of each
design: the best designs alone are looked at, one after the other, until one keeps them.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from jcontour.analysis.sensitivity import LoopPeaks, frozen_family
from jcontour.analysis.stability import DELAY_SEARCH, delay_margins
from jcontour.app.designs.design import Design, with_values
from jcontour.app.files.results.search_results import BestDesign
from jcontour.app.flags.shared import Limited
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.machine import Machine
from jcontour.app.reports.figures.sweeps import worst_errors
from jcontour.app.runs.spread.sweep_runs import DIMENSIONS, Swept
from jcontour.app.runs.tuning.limits import WINDOWS, counted, loop_limits, named_limits, noise_limit
from jcontour.simulation.evaluation import stack_plants
from tuning.loops import Looked, ProbedLoops
from tuning.objectives import COUNT_NOISE, LATE

ALIKE = 0.01  # of the least error: what counts of encoders and the places of a grid decide
LOOPS = 100  # designs of a preview whose loops are looked at: at most ten seconds
AT_ONCE = 20  # designs whose loops are made in one program
UNSTABLE = "spectral_radius"
KNOWN = {
    "comment": f"NaN: the design is not one of the {LOOPS} best of its preview; an unstable loop "
    "has the sensitivity inf and the delay margin -1"
}


def largest_of(dataset: xr.Dataset, metric: str) -> Float[np.ndarray, "P D"]:
    """Largest of a metric over contours and plants of every preview and design, SI."""
    return dataset[metric].values.max(axis=(2, 3))


def within_limits(dataset: xr.Dataset, limits: Mapping[str, float]) -> Bool[np.ndarray, "P D"]:
    """Whether no run of a preview and design diverges or exceeds a limit."""
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


def best_first(
    errors: Float[np.ndarray, " D"],
    kept: Bool[np.ndarray, " D"],
    increments: Float[np.ndarray, " D"],
) -> list[int]:
    """At most `LOOPS` designs: the best within the limits, then others by their error."""
    order, left = [], np.where(kept, errors, np.inf)
    while len(order) < LOOPS and np.isfinite(left).any():
        order.append(best_design(left, increments))
        left[order[-1]] = np.inf
    others = [sample for sample in np.argsort(errors, kind="stable").tolist() if not kept[sample]]
    return order + others[: LOOPS - len(order)]


class DesignLoops:
    """Frozen loops of designs with one preview, along the contours of a sweep."""

    def __init__(
        self,
        flags: Limited,
        design: Design,
        machine: Machine,
        scenarios: Scenarios,
        varied: Mapping[str, Float[np.ndarray, " D"]],
    ):
        self.limits = loop_limits(flags) | noise_limit(flags, machine, design)
        family = stack_plants(machine.smooth_family(design.fed))
        references = jax.device_get(scenarios.references)
        count, more = counted(self.limits, machine), flags.min_delay_margin
        self._loops = ProbedLoops.of(family, references, WINDOWS, more, count=count)
        self._shape = len(scenarios.jobs), WINDOWS, len(machine.family_names)

        def matrices(weights: dict[str, Any]):
            controller = design.complete(with_values(design.start, weights))
            return frozen_family(family, controller, self._loops.windows)

        several, chunks = eqx.filter_jit(jax.vmap(matrices)), []
        designs = len(next(iter(varied.values())))
        for first in range(0, designs, AT_ONCE):
            # always as many, the last one again and again: one program
            rows = np.minimum(np.arange(first, first + AT_ONCE), designs - 1)
            weights = {name: np.asarray(column, float)[rows] for name, column in varied.items()}
            chunks.append(jax.device_get(several(weights)))
        self._matrices = jax.tree.map(lambda *parts: np.concatenate(parts)[:designs], *chunks)

    def beyond(self, place: int) -> dict[str, float]:
        """Limits that the loops of a design break, with its values, SI; a radius of 1 always."""
        matrices = jax.tree.map(lambda leaf: leaf[place], self._matrices)
        looked, peaks = _looked(self._loops, matrices)
        largest = {
            UNSTABLE: float(np.max(peaks.spectral_radius)),
            "peak_sensitivity": float(np.max(peaks.sensitivity)),
        }
        if looked.late is not None:
            largest[LATE] = float(np.max(looked.late))
        if looked.count_noise is not None:
            largest[COUNT_NOISE] = float(np.max(looked.count_noise))
        if not largest[UNSTABLE] < 1:
            return {UNSTABLE: largest[UNSTABLE]}
        return {
            name: largest[name] for name, bound in self.limits.items() if not largest[name] <= bound
        }

    def margins(self) -> tuple[Float[np.ndarray, "D C P"], Float[np.ndarray, "D C P"]]:
        """Peak sensitivities and delay margins of all designs, the worst probe of each contour.

        The sensitivity of an unstable loop is infinite, its margin -1 samples.
        """
        loops = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), self._matrices)
        _, peaks = _looked(replace(self._loops, more=0, count=None), loops)
        shape = (-1, *self._shape)
        delays = delay_margins(loops, DELAY_SEARCH)
        return (
            np.asarray(peaks.sensitivity, float).reshape(shape).max(axis=2),
            np.asarray(delays, float).reshape(shape).min(axis=2),
        )


def _looked(loops: ProbedLoops, matrices: Any) -> tuple[Looked, LoopPeaks]:
    """Frozen loops as the tuner sees them, without slopes, and their peaks."""
    still = jax.tree.map(lambda leaf: np.zeros((*leaf.shape, 0)), matrices)
    looked = loops.look(matrices, still)[0]
    assert looked.loops is not None  # they always are
    return looked, looked.loops


def judged(asked: Swept, dataset: xr.Dataset) -> tuple[xr.Dataset, list[BestDesign]]:
    """The metrics with margins and limits, and the best design of every preview that has one."""
    error = asked.machine.error
    kept, errors = (
        within_limits(dataset, named_limits(asked.flags)),
        worst_errors(dataset, error)[0],
    )
    increments = largest_of(dataset, "rms_increment")
    samples, best = np.full(len(dataset.preview), -1), []
    sensitivity, delay = (np.full(dataset.diverged.shape, np.nan) for _ in range(2))
    for p, preview in enumerate(asked.flags.previews):
        design, order = asked.design(preview), best_first(errors[p], kept[p], increments[p])
        varied = {name: dataset[name].values[order] for name in asked.values}
        loops = DesignLoops(asked.flags, design, asked.machine, asked.scenarios(design), varied)
        sensitivity[p, order], delay[p, order] = loops.margins()
        place, looked, beyond = chosen(loops, int(kept[p][order].sum()))
        if not looked:
            continue
        samples[p] = order[place]
        here = dataset.isel(preview=p, sample=order[place])
        each = 1e6 * here[f"rms_{error}_error"].values
        peak = float(sensitivity[p, order[place]].max())
        best.append(
            BestDesign(
                preview=int(preview),
                weights={name: float(here[name]) for name in asked.values},
                worst_um=float(each.max()),
                nominal_um=float(each[:, 0].max()),
                sensitivity=peak if np.isfinite(peak) else None,
                delay_samples=int(delay[p, order[place], :, 0].min()),
                looked=looked,
                beyond=beyond,
            )
        )
    more = {
        "peak_sensitivity": (DIMENSIONS, sensitivity, {"units": "1", "long_name": "Ms", **KNOWN}),
        "delay_margin": (DIMENSIONS, delay, {"units": "samples", **KNOWN}),
        "within_limits": (("preview", "sample"), kept.astype("i1")),
        "best": ("preview", samples, {"long_name": "best sample within the limits; -1: none"}),
    }
    return dataset.assign(more), best


def chosen(loops: DesignLoops, count: int) -> tuple[int, int, dict[str, float]]:
    """The first of so many designs whose loops keep their limits, or the first one.

    Its place, the designs that were looked at, and the limits on loops that it breaks.
    """
    first: dict[str, float] = {}
    for place in range(count):
        beyond = loops.beyond(place)
        if not beyond:
            return place, place + 1, {}
        first = first or beyond
    return 0, count, first
