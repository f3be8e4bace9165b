"""How safe tuned weights are: the margins of frozen loops along the training paths."""

from typing import Any

import equinox as eqx
import numpy as np

from experiments.jobs.replays import Scenarios
from experiments.machines.machine import Fed, Machine
from jcontour.analysis.stability import DELAY_SEARCH, GAIN_SEARCH, Margins, margins
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.simulation.evaluation import member

# frozen loops per contour: they change with direction, bend and place of the path, slowly; as many
# as `margins` probes at once
PROBES = 48


def path_margins(controller: Controller, machine: Machine, scenarios: Scenarios, fed: Fed) -> dict:
    """Spectral radius, gain and delay margins over the training paths, every path frozen at up to `PROBES` of its scored samples."""
    plant = machine.nominal(fed)
    paths = [
        _thinned(member(scenarios.references, k))
        for k, trained in enumerate(scenarios.training)
        if trained
    ]
    found = [margins(plant, controller, path) for path in paths]
    names = [job.name for job in scenarios.jobs_seen(True)]
    without = [one.saturated == np.sum(path.mask) for one, path in zip(found, paths, strict=True)]
    gains = np.stack([one.gain for one in found])
    return {
        "largest_frozen_spectral_radius": max(one.spectral_radius for one in found),
        "gain_range": np.stack([gains[:, :, 0].max(axis=0), gains[:, :, 1].min(axis=0)], axis=1),
        "gain_search": [1 / GAIN_SEARCH, GAIN_SEARCH],
        "delay_samples": min(one.delay for one in found),
        "delay_search": DELAY_SEARCH,
        "probes_per_contour": PROBES,
        "probes_left_out": sum(
            one.saturated for one, none in zip(found, without, strict=True) if not none
        ),
        "contours_without_margins": [
            name for name, none in zip(names, without, strict=True) if none
        ],
        "lost_first": _lost_first(found, paths, names),
    }


def _lost_first(
    found: list[Margins], paths: list[Reference], names: list[str]
) -> dict[str, Any] | None:
    """Where the smallest gain margin is, with the reference's position [m] there; None where all are lost at once, or none."""
    gains, samples = np.stack([one.gain for one in found]), np.stack([one.gain_at for one in found])
    contour, index, side = np.unravel_index(np.argmin(np.abs(np.log(gains))), gains.shape)
    sample = samples[contour, index, side]
    if sample < 0:
        return None
    return {
        "contour": names[contour],
        "position": np.asarray(paths[contour].position)[sample],
        "input": index + 1,
    }


def _thinned(reference):
    """The same run, `PROBES` of its scored samples left in its mask, so that all paths have as many loops and compile once."""
    mask = np.array(reference.mask)
    rows = np.flatnonzero(mask)
    kept = np.zeros_like(mask)
    kept[rows[np.unique(np.linspace(0, rows.size - 1, min(PROBES, rows.size)).astype(int))]] = True
    return eqx.tree_at(lambda r: r.mask, reference, kept)
