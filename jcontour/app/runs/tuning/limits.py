"""From flags to the limits of a tuning problem, and to the loops that some of them look at."""

from dataclasses import fields
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jcontour._devices import on_cpu
from jcontour.analysis.frequency_response import Responses
from jcontour.analysis.sensitivity import (
    LoopPeaks,
    encoding_of,
    frozen_family,
    host_peaks,
    probe_windows,
    sensitivity_curves,
)
from jcontour.analysis.stability import DELAY_SEARCH
from jcontour.analysis.uncertain_loops import GRID, ResponseUncertainty
from jcontour.app.designs.design import Design
from jcontour.app.files.results.run_metrics import METRICS
from jcontour.app.flags.shared import Aimed, Limited
from jcontour.app.flags.tuning import Tune
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.machine import Fed, Machine, Usual
from jcontour.app.reports.rollouts import FamilyCurves
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import stack_plants
from jcontour.simulation.metrics import Metrics
from tuning.loops import ProbedLoops
from tuning.objectives import COUNT_NOISE, RATIO
from tuning.parameters import Weights
from tuning.problem import Problem


def _limited(flag: str) -> str:
    """Metric that a flag like `max_peak_contour_error_um` limits; an RMS where it does not say."""
    name = flag.removeprefix("max_").removesuffix("_um")
    return name if name in METRICS else f"rms_{name}"


LIMITS = {  # flag -> metric, in the unit in which it is shown
    one.name: _limited(one.name) for one in fields(Limited) if _limited(one.name) in METRICS
}
SAMPLE = 0.5e-3  # [s] in which `Design.lag` counts at least
MOVING = 0.5  # of the error of a tool that stands still: most that one may lag
AT_REST = 0.8  # of the noise of counts: held between two counts a tool had up to 1.22 times it
LATE_RADIUS = 0.999  # of a loop at its delay margin: a ring has decayed after a few 1000 samples


def named_limits(flags: Limited) -> dict[str, float]:
    """Metric and bound in SI of every limit that the flags name."""
    given = {name: getattr(flags, name) for name in LIMITS}
    return {
        LIMITS[name]: _above_zero(name, value) / METRICS[LIMITS[name]].factor
        for name, value in given.items()
        if value is not None
    }


def _above_zero(name: str, value: float) -> float:
    """A limit of that flag."""
    if not (np.isfinite(value) and value > 0):
        flag = name.replace("_", "-")
        raise ValueError(f"{flag}: a limit needs to be finite and above zero, received {value}")
    return value


def ratio_limit(flags: Tune) -> dict[str, float]:
    """Bound on the errors over those of the start, where the flags ask for it."""
    ratio = flags.max_error_ratio
    return {} if ratio is None else {RATIO: _above_zero("max_error_ratio", ratio)}


def lag_limit(
    machine: Machine, design: Design, references: Reference, start: float = 0.0
) -> dict[str, float]:
    """Bound on the RMS tracking error along contours: some samples of travel at the fastest feed.

    They last as long where samples are shorter than `SAMPLE`: a machine is no faster for that.
    Contour error alone is also small for a tool that lags, or hardly moves. The bound is at most
    `MOVING` of the error of a tool that stands still on the contour where that is largest, and at
    least half of the error of the `start` [m], see `held_back`.
    """
    if machine.error != "contour":
        return {}
    steps = jnp.linalg.norm(jnp.diff(references.position, axis=1), axis=-1)
    # RMS tracking error of a tool that stands still where each contour begins [m]
    position, counted = np.asarray(references.position), np.asarray(references.mask)
    squares = ((position - position[:, :1]) ** 2).sum(axis=-1) * counted
    samples = design.lag * max(1.0, SAMPLE / machine.model.dt)
    travel, still = (
        max(samples * float(jnp.max(steps)), start / 2),
        float(np.sqrt(squares.sum(axis=1) / np.maximum(counted.sum(axis=1), 1)).max()),
    )
    return {"rms_tracking_error": min(travel, MOVING * still) if still > 0 else travel}


def held_back(machine: Machine, problem: Problem, start: Weights) -> float:
    """Largest RMS tracking error of the start [m] where dry friction is what holds axes back.

    Zero without friction, or where the start diverges.
    """
    if machine.linear is None or not machine.linear.largest_friction:
        return 0.0
    error = float(np.max(start_metrics(problem, start).rms_tracking_error))
    return error if np.isfinite(error) else 0.0


def effort_limit(flags: Aimed, usual: Usual, problem: Problem, start: Weights) -> dict[str, float]:
    """Bound on the RMS control, as a multiple of what the start needs.

    None where the RMS control is bounded otherwise, or neither flags nor machine ask for it.

    Raises:
        ValueError: two limits of the RMS control, or a loop that diverges with the start.
    """
    effort = flags.max_effort
    if effort is not None and flags.max_rms_control is not None:
        raise ValueError(
            "max-effort, max-rms-control: both limit the RMS control; give one of them"
        )
    if effort is not None:
        _above_zero("max_effort", effort)
    effort = effort or usual.effort
    if effort is None or flags.max_rms_control is not None:
        return {}
    needed = float(np.max(start_metrics(problem, start).rms_control))
    if not np.isfinite(needed) and flags.max_effort is None:
        return {}  # the search has to stabilise the loop first
    if not np.isfinite(needed):
        raise ValueError(
            "max-effort: the loop diverges with the first weights, so no effort is known; "
            "give others with --weights, or --max-rms-control"
        )
    return {"rms_control": effort * needed}


def start_metrics(problem: Problem, start: Weights) -> Metrics:
    """Metrics (contour, plant) of the first weights on the smooth machines."""
    return eqx.filter_jit(lambda problem, weights: problem.metrics(weights))(problem, start)


def loop_limits(flags: Limited) -> dict[str, float]:
    """Bounds on the peak sensitivity and on the radius with more delay, where flags ask."""
    bound, more = flags.max_sensitivity, flags.min_delay_margin
    if bound is not None and not bound > 1:
        raise ValueError(f"max-sensitivity: no loop keeps 1 or less, received {bound}")
    if not 0 <= more <= DELAY_SEARCH:
        raise ValueError(f"min-delay-margin: needs 0 to {DELAY_SEARCH} samples, received {more}")
    late = {"late_radius": LATE_RADIUS} if more else {}
    return late if bound is None else {"peak_sensitivity": bound, **late}


def noise_limit(flags: Limited, machine: Machine, design: Design) -> dict[str, float]:
    """Bound on the RMS control by encoder counts, as a part of the machine's largest control.

    The search takes rounding for white noise. That of a held tool is none, and may cause more: the
    search keeps `AT_REST` of what is allowed.

    None where nothing is counted, or the machine states no limit of its control.
    """
    part, largest = flags.max_count_noise, machine.limits.control
    share = None if part is None else _above_zero("max_count_noise", part)
    if share is None or largest is None or design.fed == "state" or machine.resolution is None:
        return {}
    return {COUNT_NOISE: AT_REST * share * float(np.min(largest))}


def counted(limits: dict[str, float], machine: Machine) -> float | np.ndarray | None:
    """Counts as noisy as the encoders [m], of all or of each, where their noise is limited."""
    return machine.noisy_count if COUNT_NOISE in limits else None


def probed_loops(
    flags: Limited,
    problem: Problem,
    uncertainty: ResponseUncertainty | None,
    count: float | np.ndarray | None,
) -> ProbedLoops | None:
    """The frozen loops that the limits look at; None where none does."""
    if not loop_limits(flags) and uncertainty is None and count is None:
        return None
    return ProbedLoops.of(
        problem.plants, problem.references, WINDOWS, flags.min_delay_margin, uncertainty, count
    )


WINDOWS = 8  # per contour, at which the sensitivity is looked at
FREQUENCIES = np.geomspace(1e-3, 1.0, 241) * np.pi  # [rad per sample]


class LeastKnown(NamedTuple):
    """Where a loop rests most on what is not known of the response."""

    hertz: float  # frequency [Hz]
    relative: float  # by how much the response may be off there
    complementary: float  # largest complementary sensitivity of the family there


def family_peaks(
    controller: Controller, machine: Machine, scenarios: Scenarios, fed: Fed
) -> LoopPeaks:
    """Peaks at the probes of the training paths, over the whole smooth family."""
    family, windows = _probed(machine, scenarios, fed)
    return probed_peaks(family, controller, windows, machine.response_uncertainty)


def probed_peaks(
    family: Plant,
    controller: Controller,
    windows: Reference,
    uncertainty: ResponseUncertainty | None = None,
) -> LoopPeaks:
    """Peaks of a family at the windows of some probes."""
    with on_cpu():  # few and small
        loops = jax.device_get(frozen_family(family, controller, windows))
    return host_peaks(loops, encoding_of(family, windows), uncertainty)


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
    """Where the loops of the family rest most on what is not known of the response."""
    if (uncertainty := machine.response_uncertainty) is None:
        raise ValueError("machine: nothing is said of its response")
    family, windows = _probed(machine, scenarios, fed)
    with on_cpu():
        loops = jax.device_get(frozen_family(family, controller, windows))
    frequency = np.union1d(GRID, uncertainty.frequency)
    responses = Responses.of(loops, encoding_of(family, windows))
    each = np.abs(np.diagonal(responses.control_complementary(frequency), axis1=-2, axis2=-1))
    largest = np.nan_to_num(each, posinf=0.0).max(axis=tuple(range(each.ndim - 2)))
    relative = uncertainty.at(frequency)
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
    return float(
        np.max(probed_peaks(nominal, controller, windows, machine.response_uncertainty).sensitivity)
    )


def _probed(machine: Machine, scenarios: Scenarios, fed: Fed) -> tuple[Plant, Reference]:
    """Smooth family, and windows of the training paths."""
    trained = np.flatnonzero(scenarios.training)
    paths = jax.tree.map(lambda leaf: leaf[trained], jax.device_get(scenarios.references))
    return stack_plants(machine.smooth_family(fed)), probe_windows(paths, WINDOWS)
