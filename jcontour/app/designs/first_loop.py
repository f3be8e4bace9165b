"""A first loop for any linear machine: the fastest of a series that keeps a margin.

The regulator is fast, and the bandwidth w of the observer alone decides the margin: loop transfer
recovery (Doyle & Stein, IEEE Trans. Automatic Control 26, 1981). Weights follow from the gain |G|
of the machine, its smallest singular value at a frequency in rad per sample:

    (alpha + beta) / rho = 1 / |G(r)|^2      the regulator crosses over at r rad per sample
    drift / rounding = w / |G(w)|            the observer's disturbance loop crosses over at w
    control noise / rounding = 0.3 / |G(w)|  its state estimate is not much faster

r is 1, or less where a few counts of the encoder would take the controls to their limit. A machine
that holds its place with a control, as a drive that takes positions, would stay behind by the share

    rho / (rho + alpha |G(0)|^2)

of where it should be, as rho weighs that control: alpha is so large that it is a millionth. Of a
series of w the fastest is taken whose peak sensitivity stays below 2, on straight lines along
an axis and across all of them, for the whole family.
"""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jcontour._devices import on_cpu
from jcontour.analysis.frozen_loops import FrozenLoop
from jcontour.analysis.sensitivity import encoding_of, frozen_family, host_peaks, probe_windows
from jcontour.analysis.uncertain_loops import BORNE, ResponseUncertainty
from jcontour.app.designs.design import Gains
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine import Fed
from jcontour.controller import Controller
from jcontour.geometry.contours import line
from jcontour.motion.references import Reference, along
from jcontour.plant import Plant
from jcontour.simulation.evaluation import stack_plants, stack_references

# [rad per sample] from fast to slow: the first settles within a few samples, and corners do not
# kick
REGULATORS = np.geomspace(1.0, 0.05, 30)
COUNTS = 20.0  # that a position is off, for which the control may be at its limit (Bryson's rule)
CONTOUR_RATIO = 1.0  # beta / alpha
BEHIND = 1e-6  # of its place, that a machine may be which holds it with a control
STANDING = 1e-6  # [rad per sample] at which a machine that needs no control has no such gain
STATES = 0.3  # noise of the controls, over that which would cross over at w by itself
SENSITIVITY = 2.0  # peak that a first loop may have: 6 dB, the usual bound
BANDWIDTHS = np.geomspace(0.5, 1e-3, 16)  # [rad per sample] from fast to slow


def first_loop(
    machine: LinearMachine,
    build: Callable[[Gains], Controller],
    start: Gains,
    preview: int,
    fed: Fed,
) -> Gains:
    """Weights of the fastest loop of the series that keeps the margin; rho and stage of `start`."""
    series = [_weights(machine, bandwidth, start) for bandwidth in BANDWIDTHS]
    return series[fastest(machine, series, build, preview, fed)]


def fastest(
    machine: LinearMachine,
    series: Sequence[Any],
    build: Callable[[Any], Controller],
    preview: int = 1,
    fed: Fed = "outputs",
) -> int:
    """Index of the first loop of a series that keeps the margin on the family.

    Where none keeps it, that with the smallest peak: tuning begins by mending it.

    Args:
        machine: whose family it is.
        series: weights from fast to slow.
        build: makes the controller of such weights.
        preview: samples that it looks ahead.
        fed: what it is fed.
    """
    stacked = jax.tree.map(lambda *values: jnp.stack([jnp.asarray(v) for v in values]), *series)
    family, windows = stack_plants(machine.smooth_family(fed)), straight_windows(machine, preview)
    peaks = sensitivity_peaks(build, stacked, family, windows, machine.response_uncertainty)
    kept = np.flatnonzero(peaks <= SENSITIVITY)
    return int(kept[0] if kept.size else np.argmin(peaks))


def _weights(machine: LinearMachine, bandwidth: float, start: Gains) -> Gains:
    regulator = bandwidth if "control_noise" not in start else _regulator(machine)
    rho = float(start["rho"])
    crossing = rho / _gain(machine, regulator) ** 2 / (1 + CONTOUR_RATIO)
    alpha = max(crossing, rho / _gain(machine, STANDING) ** 2 / BEHIND)
    weights = start | {"alpha": alpha, "beta": CONTOUR_RATIO * alpha}
    if "control_noise" not in start:
        return weights
    noise = _reached(machine, machine.measurement_noise, bandwidth)
    if "drift" not in start:
        return weights | {"control_noise": noise}
    return weights | {"control_noise": STATES * noise, "drift": bandwidth * noise}


def _regulator(machine: LinearMachine) -> float:
    """Fastest regulator [rad per sample] whose controls bear some counts within their limit."""
    if machine.limits.control is None:
        return float(REGULATORS[0])
    error = COUNTS * machine.noisy_count
    kept = [r for r in REGULATORS if _reached(machine, error, r) <= machine.largest_control]
    return float(kept[0] if kept else REGULATORS[-1])


def _reached(machine: LinearMachine, errors: float | np.ndarray, bandwidth: float) -> float:
    """Largest control that makes errors of these sizes [m], of all axes or of each, at exp(j w)."""
    largest = np.max(errors)
    return float(largest) / _gain(machine, bandwidth, largest / errors)


def _gain(machine: LinearMachine, bandwidth: float, weights: float | np.ndarray = 1.0) -> float:
    """Smallest singular value of C (zI - A)^-1 B at exp(j w), w in rad per sample.

    Each axis in the weights.
    """
    A, B, C = (np.asarray(matrix) for matrix in (machine.model.A, machine.model.B, machine.model.C))
    G = C @ np.linalg.solve(np.exp(1j * bandwidth) * np.eye(len(A)) - A, B)
    weighted = np.reshape(weights, (-1, 1)) * G
    return float(np.linalg.svd(weighted, compute_uv=False)[-1])


def straight_windows(machine: LinearMachine, preview: int) -> Reference:
    """Windows on straight lines along the first axis and across all of them."""
    axes, dt = machine.model.axes, machine.model.dt
    directions = np.eye(axes)[0], np.ones(axes) / np.sqrt(axes)
    step = 1e-5  # [m] per sample: the loops of a linear machine do not depend on it
    paths = [line(np.zeros(axes), direction) for direction in directions]
    runs = [along(path, [0.0, step], dt, preview, at_rest=False) for path in paths]
    return probe_windows(stack_references(runs), 1)


def sensitivity_peaks(
    build, series, family: Plant, windows: Reference, uncertainty: ResponseUncertainty | None = None
) -> np.ndarray:
    """Largest peak sensitivity of every loop of the series, weights with a leading axis.

    What an uncertain response uses up counts alike: `SENSITIVITY` is its bound, too.
    """
    with on_cpu():  # few and small
        loops = jax.device_get(_loops(build, series, family, windows))
    peaks = host_peaks(loops, encoding_of(family, windows), uncertainty)
    used = np.maximum(peaks.sensitivity, SENSITIVITY * np.asarray(peaks.uncertainty) / BORNE)
    return np.max(used, axis=(1, 2))


@eqx.filter_jit
def _loops(build, series, family: Plant, windows: Reference) -> FrozenLoop:
    return jax.vmap(lambda weights: frozen_family(family, build(weights), windows))(series)
