"""Stability margins along the training paths, with the gains held at points of each path."""

import equinox as eqx
import jax
import numpy as np

from jcontour.analysis.probes import probe_samples
from jcontour.analysis.sensitivity import LoopPeaks
from jcontour.analysis.stability import DELAY_SEARCH, GAIN_SEARCH, Margins, margins
from jcontour.app.files.results.tuned_result import LostFirst, PathMargins
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.machine import Fed, Machine
from jcontour.controller import Controller
from jcontour.devices import on_cpu
from jcontour.motion.references import Reference
from jcontour.simulation.evaluation import member

PROBES = 16  # loops per contour: they change with direction, bend and place of the path, slowly


@on_cpu()  # few and small
def path_margins(
    controller: Controller,
    machine: Machine,
    scenarios: Scenarios,
    fed: Fed,
    peaks: LoopPeaks,
) -> PathMargins:
    """Spectral radius, gain and delay margins over the training paths, and peak sensitivities.

    Every path is probed at up to `PROBES` of its scored samples.
    """
    plant = machine.nominal(fed)
    names = [job.name for job in scenarios.jobs_seen(True)]
    trained = np.flatnonzero(scenarios.training).tolist()
    references = jax.device_get(scenarios.references)
    paths = [_thinned(member(references, k)) for k in trained]
    found = [margins(plant, controller, path) for path in paths]
    open_loops = np.array([one.saturated for one in found])
    without = open_loops == np.array([np.sum(path.mask) for path in paths])
    gains = np.stack([one.gain for one in found])
    low, high = gains[:, :, 0].max(axis=0), gains[:, :, 1].min(axis=0)
    return PathMargins(
        spectral_radius=float(max(one.spectral_radius for one in found)),
        gain_range=tuple(zip(low.tolist(), high.tolist(), strict=True)),
        gain_search=(1 / GAIN_SEARCH, GAIN_SEARCH),
        delay_samples=int(min(one.delay for one in found)),
        delay_search=DELAY_SEARCH,
        probes_per_contour=PROBES,
        probes_left_out=int(open_loops[~without].sum()),
        contours_without_margins=tuple(np.array(names)[without].tolist()),
        lost_first=lost_first(found, paths, names),
        **_largest(peaks, doubted=machine.doubt is not None),
    )


def _largest(peaks: LoopPeaks, doubted: bool) -> dict[str, float | None]:
    largest = {
        "sensitivity": float(np.max(peaks.sensitivity)),
        "complementary": float(np.max(peaks.complementary)),
    }
    if doubted:
        largest["doubt"] = float(np.max(peaks.doubt))
    return {name: peak if np.isfinite(peak) else None for name, peak in largest.items()}


def lost_first(found: list[Margins], paths: list[Reference], names: list[str]) -> LostFirst | None:
    """Where the smallest gain margin is; None where all loops are lost at once, or none."""
    gains = np.stack([one.gain for one in found])
    samples = np.stack([one.gain_at for one in found])
    contour, index, side = np.unravel_index(np.argmin(np.abs(np.log(gains))), gains.shape)
    sample = samples[contour, index, side]
    if sample < 0:
        return None
    position = np.asarray(paths[contour].position)[sample]
    return LostFirst(names[contour], tuple(position.tolist()), int(index) + 1)


def _thinned(reference: Reference) -> Reference:
    """The same run with `PROBES` scored samples at most.

    All paths then have as many loops, and one program does for them.
    """
    kept = np.zeros(reference.mask.shape, bool)
    kept[probe_samples(reference, PROBES)] = True
    return eqx.tree_at(lambda r: r.mask, reference, kept)
