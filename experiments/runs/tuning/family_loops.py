"""Sensitivity of the whole family: peaks, and curves over frequency, at the probes of the paths."""

import jax
import numpy as np

from experiments.jobs.replays import Scenarios
from experiments.machines.machine import Fed, Machine
from experiments.reports.figures.tuning.sensitivity import FamilyCurves
from jcontour.analysis.probes import probe_windows
from jcontour.analysis.sensitivity import (
    LoopPeaks,
    encoding_of,
    frozen_family,
    host_peaks,
    sensitivity_curves,
)
from jcontour.analysis.uncertain_loops import Doubt
from jcontour.controller import Controller
from jcontour.devices import on_cpu
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import stack_plants

WINDOWS = 8  # per contour, at which the sensitivity is looked at
FREQUENCIES = np.geomspace(1e-3, 1.0, 241) * np.pi  # [rad per sample]


def family_peaks(
    controller: Controller, machine: Machine, scenarios: Scenarios, fed: Fed
) -> LoopPeaks:
    """Peaks at the probes of the training paths, over the whole smooth family."""
    family, windows = _probed(machine, scenarios, fed)
    return probed_peaks(family, controller, windows, machine.doubt)


def probed_peaks(
    family: Plant, controller: Controller, windows: Reference, doubt: Doubt | None = None
) -> LoopPeaks:
    """Peaks of a family at the windows of some probes."""
    with on_cpu():  # few and small
        loops = jax.device_get(frozen_family(family, controller, windows))
    return host_peaks(loops, encoding_of(family, windows), doubt)


def family_curves(
    controller: Controller, machine: Machine, scenarios: Scenarios, fed: Fed, peaks: LoopPeaks
) -> FamilyCurves:
    """Curves over the probes and plants of `family_peaks`."""
    family, windows = _probed(machine, scenarios, fed)
    with on_cpu():
        curves = sensitivity_curves(family, controller, windows, FREQUENCIES).max(axis=0)
    stable = np.max(peaks.spectral_radius, axis=0) < 1
    hertz = FREQUENCIES / (2 * np.pi * machine.model.dt)
    return FamilyCurves(hertz, np.where(stable[:, None], curves, np.nan))


def _probed(machine: Machine, scenarios: Scenarios, fed: Fed) -> tuple[Plant, Reference]:
    """Smooth family, and windows of the training paths."""
    trained = np.flatnonzero(scenarios.training)
    paths = jax.tree.map(lambda leaf: leaf[trained], jax.device_get(scenarios.references))
    return stack_plants(machine.smooth_family(fed)), probe_windows(paths, WINDOWS)
