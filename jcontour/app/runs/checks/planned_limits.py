"""Limits of a machine that a motion itself exceeds, whatever the loop makes of it."""

import numpy as np

from jcontour.app.jobs.job import Job, Task
from jcontour.app.jobs.replays import Scenarios, desired, measured_speeds
from jcontour.app.machines.machine import Machine

ROUNDING = 1 + 1e-4  # of a limit: positions are rounded, and their differences more
ALIKE = 1 - 1e-9  # rounding chooses none of these
QUANTITIES = (("speed", "m/s"), ("acceleration", "m/s^2"))


def limits_exceeded_by_plan(scenarios: Scenarios, machine: Machine) -> list[str]:
    """One line for a limit of speed, and one for acceleration, that a motion itself exceeds.

    Each tells every axis of the motion that exceeds its limit most, and where. Speed and
    acceleration are differences of the samples, of all of them, in rapid moves as well.
    """
    dt, lines = machine.model.dt, []
    for row, (quantity, unit) in enumerate(QUANTITIES):
        limit = getattr(machine.limits, quantity)
        if limit is None:
            continue
        asked = [
            np.abs(measured_speeds(_with_rests(job, points[: job.samples]), dt)[row])
            for job, points in zip(scenarios.jobs, desired(scenarios), strict=True)
        ]
        job, most = max(
            zip(scenarios.jobs, asked, strict=True),
            key=lambda one: (one[1] / limit).max(initial=0.0),
        )
        if (most > ROUNDING * limit).any():
            lines.append(
                f"{quantity} that the motion itself asks for EXCEEDS the limit: "
                f"{_axes(most, limit, machine)} {unit} ({job.name}, "
                f"{_place(job, most, limit, machine)}): the plan does so, not the loop"
                f"{_help(job, quantity)}"
            )
    return lines


def _with_rests(job: Task, points: np.ndarray) -> np.ndarray:
    """Samples of a motion (T, m), between rests of a sample if it begins and ends at rest."""
    if not (isinstance(job, Job) and job.at_rest):
        return points
    return np.concatenate([points[:1], points, points[-1:]])


def _axes(asked: np.ndarray, limit: np.ndarray, machine: Machine) -> str:
    """Largest value and limit of every axis that exceeds it."""
    return ", ".join(
        f"{name} {value:.4g} of {allowed:.4g}"
        for name, value, allowed in zip(machine.axes, asked.max(axis=0), limit, strict=True)
        if value > ROUNDING * allowed
    )


def _place(job: Task, asked: np.ndarray, limit: np.ndarray, machine: Machine) -> str:
    """Axis and sample of the largest excess, of several alike the first."""
    share = asked / limit
    row, axis = np.argwhere(share >= ALIKE * share.max())[0]
    rests = int(isinstance(job, Job) and job.at_rest)
    sample = int(np.clip(row + 1 - rests, 0, job.samples - 1))  # which the difference ends or turns
    line = job.line_at(sample)
    told = "" if line is None else f", line {line} of the file"
    return f"{machine.axes[int(axis)]} at t {sample * machine.model.dt:.4g} s{told}"


def _help(job: Task, quantity: str) -> str:
    """Why it does, and the flag that keeps the limit; empty where none does."""
    if not isinstance(job, Job) or job.planned is not None:
        return ""
    if not job.at_rest:
        return "; a lower --feed-mm-per-min keeps it"
    if quantity == "speed":
        return "; --feed-law jerk keeps it"
    return ": in corners a trapezoidal motion jumps in speed; --feed-law jerk keeps the limit"
