"""What a user of `jcontour tune` has to know of a run before trusting its weights, one line each."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from experiments.jobs.replays import Replay, Scenarios, measured_speeds, scored
from experiments.machines.machine import Machine
from experiments.runs.tuning import TuningRun
from tuning.tune import Tuned

NEAR = 0.9  # of a limit, from which on there is a warning
MUCH_LAG = 5.0  # times the tracking error of the start, from which on there is a warning


def run_warnings(
    job: TuningRun, tuned: Tuned, safety: dict[str, Any], replays: dict[str, Replay]
) -> list[str]:
    """All of them; `safety` is the `path_margins` of what was found, `replays` are those of start and tuned weights."""
    found = replays["tuned"]
    diverged = [
        f"a run of the machine with {job.machine.nonsmooth_effects} diverges with the tuned weights"
    ] * bool(np.any(found.metrics.diverged))
    return [
        *diverged,
        *search_warnings(tuned),
        *margin_warnings(safety, job.machine.unknown_delay),
        *limit_warnings(found, job.scenarios, job.machine),
        *lag_warnings(replays, job.scenarios),
    ]


def search_warnings(tuned: Tuned) -> list[str]:
    """What the tuner did not find, and what it had to reject."""
    lines = []
    if not tuned.feasible:
        lines.append(
            f"no feasible point was found; these weights exceed a limit by {100 * np.expm1(tuned.violation):.3g} %"
        )
    if tuned.diverged_points:
        lines.append(
            f"{tuned.diverged_points} of {len(tuned.history)} evaluated points had a diverging plant and were rejected"
        )
    if tuned.diverged_starts:
        lines.append(
            f"{tuned.diverged_starts} descents could not begin because their start diverges"
        )
    return lines


def margin_warnings(safety: dict[str, Any], unknown_delay: int) -> list[str]:
    """Loops that are open, unstable, or do not bear a machine that is `unknown_delay` samples late."""
    lines = []
    if safety["contours_without_margins"]:
        where = f"every probed point of {', '.join(safety['contours_without_margins'])}"
        lines.append(
            f"there are no margins: at {where} a control is at its limit, or has a gain of zero, and the loop is open"
        )
    elif safety["largest_frozen_spectral_radius"] >= 1:
        lines.append("a frozen loop along the training paths is unstable")
    elif safety["delay_samples"] < unknown_delay:
        late = f"{safety['delay_samples'] + 1} sample{'s' if safety['delay_samples'] else ''} late"
        lines.append(
            f"{late}, as this machine may be, a frozen loop along the training paths is unstable: longer runs may ring"
        )
    if safety["probes_left_out"]:
        points = f"{safety['probes_left_out']} probed point{'s' if safety['probes_left_out'] > 1 else ''}"
        lines.append(
            f"margins leave out {points} where a control is at its limit, or has a gain of zero, and the loop is open"
        )
    return lines


def limit_warnings(replay: Replay, scenarios: Scenarios, machine: Machine) -> list[str]:
    """One line for every machine limit that the nominal run or the worst of the family exceeds, or meets to within 10 %."""
    lines = []
    for axis_or_input, quantity, unit, peak, at, limit in _peaks(replay, scenarios, machine):
        if peak >= NEAR * limit:
            state = "EXCEEDS" if peak > limit else "is near"
            lines.append(
                f"{quantity} of {axis_or_input} {state} its limit: {peak:.4g} of {limit:.4g} {unit} ({at})"
            )
    return lines


def lag_warnings(replays: dict[str, Replay], scenarios: Scenarios) -> list[str]:
    """Contour error alone is also small for a tool that hardly moves: say so where the tuned tool lags far more than before."""
    before, after = (
        1e6 * np.asarray(replays[name].metrics.rms_tracking_error).max(axis=1)
        for name in ("start", "tuned")
    )
    worst = int(np.argmax(after / before))
    if after[worst] < MUCH_LAG * before[worst]:
        return []
    return [
        f"the tool lags {after[worst]:.4g} um behind on {scenarios.jobs[worst].name} (start: {before[worst]:.4g} um): contour error alone "
        "does not mind; limit it with --max-tracking-error-um"
    ]


def _peaks(
    replay: Replay, scenarios: Scenarios, machine: Machine
) -> Iterator[tuple[str, str, str, float, str, float]]:
    """Peak of every limited quantity of every axis, with contour and plant where it occurred."""
    counts = scored(scenarios)
    increment = np.diff(replay.control, axis=-2)
    speed, acceleration = measured_speeds(replay.output, machine.model.dt)
    unit = machine.control_unit
    inputs = [f"input {k + 1}" for k in range(machine.model.inputs)]
    for limit, quantity, values, of, shown in (
        (machine.limits.speed, "speed", speed, machine.axes, "m/s"),
        (machine.limits.acceleration, "acceleration", acceleration, machine.axes, "m/s^2"),
        (machine.limits.control, "control", replay.control, inputs, unit),
        (machine.limits.increment, "control increment", increment, inputs, f"{unit} per sample"),
    ):
        if limit is None:
            continue
        skipped = counts.shape[1] - values.shape[2]
        whole = np.asarray(
            np.lib.stride_tricks.sliding_window_view(counts, skipped + 1, axis=1).all(axis=-1)
        )
        peaks = np.where(whole[:, None, :, None], np.abs(values), 0.0).max(axis=2)
        for k, name in enumerate(of):
            contour, plant = np.unravel_index(np.argmax(peaks[:, :, k]), peaks.shape[:2])
            at = f"{scenarios.jobs[contour].name}, {scenarios.plants[plant]}"
            yield name, quantity, shown, float(peaks[contour, plant, k]), at, float(limit[k])
