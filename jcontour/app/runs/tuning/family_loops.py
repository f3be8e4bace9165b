"""Sensitivity of the whole family: peaks, and curves over frequency, at the probes of the paths."""

from typing import NamedTuple

import jax
import numpy as np

from jcontour._devices import on_cpu
from jcontour.analysis.frequency_response import Responses
from jcontour.analysis.probes import probe_windows
from jcontour.analysis.sensitivity import (
    LoopPeaks,
    encoding_of,
    frozen_family,
    host_peaks,
    sensitivity_curves,
)
from jcontour.analysis.uncertain_loops import GRID, Doubt
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.machine import Fed, Machine
from jcontour.app.reports.figures.searches import FamilyCurves
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import stack_plants

WINDOWS = 8  # per contour, at which the sensitivity is looked at
FREQUENCIES = np.geomspace(1e-3, 1.0, 241) * np.pi  # [rad per sample]


class LeastKnown(NamedTuple):
    """Where a loop rests most on what is not known of the response.

    Attributes:
        hertz: frequency [Hz].
        relative: by how much the response may be off there.
        complementary: largest complementary sensitivity of the family there.
    """

    hertz: float
    relative: float
    complementary: float


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


def least_known(
    controller: Controller, machine: Machine, scenarios: Scenarios, fed: Fed
) -> LeastKnown:
    """Where the loops of the family rest most on what is not known of the response.

    Raises:
        ValueError: the machine says nothing of its response.
    """
    if (doubt := machine.doubt) is None:
        raise ValueError("machine: nothing is said of its response")
    family, windows = _probed(machine, scenarios, fed)
    with on_cpu():
        loops = jax.device_get(frozen_family(family, controller, windows))
    frequency = np.union1d(GRID, doubt.frequency)
    responses = Responses.of(loops, encoding_of(family, windows))
    each = np.abs(np.diagonal(responses.control_complementary(frequency), axis1=-2, axis2=-1))
    largest = np.nan_to_num(each, posinf=0.0).max(axis=tuple(range(each.ndim - 2)))
    relative = doubt.at(frequency)
    place, axis = np.unravel_index(np.argmax(relative * largest), relative.shape)
    hertz = float(frequency[place]) / (2 * np.pi * machine.model.dt)
    return LeastKnown(hertz, float(relative[place, axis]), float(largest[place, axis]))


def measured_peak(
    controller: Controller, machine: Machine, scenarios: Scenarios, fed: Fed
) -> float | None:
    """Peak sensitivity of the nominal loops, around what was measured as well where it is larger.

    None where nothing was measured.
    """
    if not any(one.frequency.size for one in machine.measured):
        return None
    _, windows = _probed(machine, scenarios, fed)
    nominal = stack_plants([machine.nominal(fed)])
    return float(np.max(probed_peaks(nominal, controller, windows, machine.doubt).sensitivity))


def _probed(machine: Machine, scenarios: Scenarios, fed: Fed) -> tuple[Plant, Reference]:
    """Smooth family, and windows of the training paths."""
    trained = np.flatnonzero(scenarios.training)
    paths = jax.tree.map(lambda leaf: leaf[trained], jax.device_get(scenarios.references))
    return stack_plants(machine.smooth_family(fed)), probe_windows(paths, WINDOWS)
