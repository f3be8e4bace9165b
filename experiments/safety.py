"""How safe tuned weights are: frozen loops along the training paths, and how near the runs came to the limits of the machine."""

from typing import Any

import equinox as eqx
import numpy as np

from experiments.machines import Machine, Measured
from experiments.replays import Course, Replay, measured_speeds, scored
from jcontour.controller import Controller
from jcontour.evaluation import member
from jcontour.references import Reference
from jcontour.stability import DELAY_SEARCH, GAIN_SEARCH, Margins, margins

PROBES = 48  # frozen loops per contour: they change with direction, bend and place of the path, slowly; as many as `margins` probes at once
NEAR = 0.9  # of a limit, from which on there is a warning


def path_margins(controller: Controller, machine: Machine, course: Course, measured: Measured) -> dict:
    """Spectral radius, gain and delay margins over the training paths, every path frozen at up to `PROBES` of its scored samples."""
    plant = machine.nominal(measured)
    paths = [_thinned(member(course.references, k)) for k, trained in enumerate(course.training) if trained]
    found = [margins(plant, controller, path) for path in paths]
    gains = np.stack([one.gain for one in found])
    return {
        "largest_frozen_spectral_radius": max(one.spectral_radius for one in found),
        "gain_range": np.stack([gains[:, :, 0].max(axis=0), gains[:, :, 1].min(axis=0)], axis=1),
        "gain_search": [1 / GAIN_SEARCH, GAIN_SEARCH],
        "delay_samples": min(one.delay for one in found),
        "delay_search": DELAY_SEARCH,
        "probes_per_contour": PROBES,
        "probes_at_limit": sum(one.at_limit for one in found),
        "lost_first": _lost_first(found, paths, [job.name for job in course.jobs_seen(True)]),
    }


def _lost_first(found: list[Margins], paths: list[Reference], names: list[str]) -> dict[str, Any] | None:
    """Where the smallest gain margin is, the tool's position [m] there among it; None where all are lost at once, or none."""
    gains, samples = np.stack([one.gain for one in found]), np.stack([one.gain_at for one in found])
    contour, index, side = np.unravel_index(np.argmin(np.abs(np.log(gains))), gains.shape)
    sample = samples[contour, index, side]
    if sample < 0:
        return None
    return {"contour": names[contour], "position": np.asarray(paths[contour].position)[sample], "input": index + 1}


def _thinned(reference):
    """The same run, `PROBES` of its scored samples left in its mask, so that all paths have as many loops and compile once."""
    mask = np.array(reference.mask)
    rows = np.flatnonzero(mask)
    kept = np.zeros_like(mask)
    kept[rows[np.unique(np.linspace(0, rows.size - 1, min(PROBES, rows.size)).astype(int))]] = True
    return eqx.tree_at(lambda r: r.mask, reference, kept)


def limit_warnings(replay: Replay, course: Course, machine: Machine) -> list[str]:
    """One line for every machine limit that the nominal run or the worst of the family exceeds, or meets to within 10 %."""
    lines = []
    for axis_or_input, quantity, unit, peak, at, limit in _peaks(replay, course, machine):
        if peak >= NEAR * limit:
            state = "EXCEEDS" if peak > limit else "is near"
            lines.append(f"{quantity} of {axis_or_input} {state} its limit: {peak:.4g} of {limit:.4g} {unit} ({at})")
    return lines


def _peaks(replay: Replay, course: Course, machine: Machine):
    """Peak of every limited quantity of every axis, with contour and plant where it occurred."""
    counts = scored(course)
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
        whole = np.asarray(np.lib.stride_tricks.sliding_window_view(counts, skipped + 1, axis=1).all(axis=-1))
        peaks = np.where(whole[:, None, :, None], np.abs(values), 0.0).max(axis=2)
        for k, name in enumerate(of):
            contour, plant = np.unravel_index(np.argmax(peaks[:, :, k]), peaks.shape[:2])
            at = f"{course.jobs[contour].name}, {course.plants[plant]}"
            yield name, quantity, shown, float(peaks[contour, plant, k]), at, float(limit[k])
