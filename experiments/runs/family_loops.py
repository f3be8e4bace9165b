"""Sensitivity of the whole family: peaks, and curves over frequency, at the probes of the paths."""

import jax
import numpy as np

from experiments.jobs.replays import Scenarios
from experiments.machines.machine import Fed, Machine
from experiments.reports.sensitivity_figure import FamilyCurves
from jcontour.analysis.frequency_response import Encoding, Responses
from jcontour.analysis.frozen_loops import FrozenLoop
from jcontour.analysis.peak_search import loop_measures
from jcontour.analysis.probes import probe_windows
from jcontour.analysis.sensitivity import LoopPeaks, encoding_of, frozen_family
from jcontour.controller import Controller
from jcontour.simulation.evaluation import stack_plants

WINDOWS = 8  # per contour, at which the sensitivity is looked at
FREQUENCIES = np.geomspace(1e-3, 1.0, 241) * np.pi  # [rad per sample]


def family_peaks(
    controller: Controller, machine: Machine, scenarios: Scenarios, fed: Fed
) -> LoopPeaks:
    """Peaks at the probes of the training paths, over the whole smooth family."""
    return _peaks(*_frozen(controller, machine, scenarios, fed))


def family_curves(
    controller: Controller, machine: Machine, scenarios: Scenarios, fed: Fed
) -> FamilyCurves:
    """Curves over the same probes and plants."""
    loops, encoding = _frozen(controller, machine, scenarios, fed)
    heights = Responses.of(loops, encoding).heights(FREQUENCIES)[..., 0]
    stable = (_peaks(loops, encoding).spectral_radius < 1).all(axis=0)
    curves = np.broadcast_to(heights, (heights.shape[0], stable.size, FREQUENCIES.size)).max(axis=0)
    hertz = FREQUENCIES / (2 * np.pi * machine.model.dt)
    return FamilyCurves(hertz, np.where(stable[:, None], curves, np.nan))


def _peaks(loops: FrozenLoop, encoding: Encoding) -> LoopPeaks:
    values, _ = loop_measures(loops, encoding)
    return LoopPeaks(*np.moveaxis(values, -1, 0))


def _frozen(
    controller: Controller, machine: Machine, scenarios: Scenarios, fed: Fed
) -> tuple[FrozenLoop, Encoding]:
    """Loops (probe, plant) of the training paths."""
    trained = np.flatnonzero(scenarios.training)
    paths = jax.tree.map(lambda leaf: leaf[trained], jax.device_get(scenarios.references))
    windows = probe_windows(paths, WINDOWS)
    family = stack_plants(machine.smooth_family(fed))
    return jax.device_get(frozen_family(controller, family, windows)), encoding_of(family, windows)
