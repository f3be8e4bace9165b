"""Limits of a machine that a run comes near or exceeds, in cuts and in rapid moves."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from experiments.jobs.job import Job
from experiments.jobs.replays import Replay, Scenarios, desired, measured_speeds, scored
from experiments.machines.machine import Machine
from jcontour.linear.between_samples import alternating

DRIVES = ("control", "control increment")
MET = 1 - 1e-9  # of a limit: a plant holds its control there
ROUNDING = 1 + 1e-6  # of what a reference asks for
PLAN_ROUNDING = 1e-4  # of a limit, in differences of a plan's samples
NEAR = 0.9  # of a limit, from which on there is a warning
# of a limit of speed, by which a loop may overshoot a motion that keeps it: drives trip at a tenth
OVERSHOOT = 0.05
RINGING = 0.1  # of a limit, from which on what is between samples is told


class Peak(NamedTuple):
    """Largest value of a limited quantity, and where it occurred."""

    name: str  # of the axis or input
    quantity: str
    unit: str
    value: float
    contour: str
    plant: str
    limit: float
    hidden: float = 0.0  # part of the value that is between the samples
    overshoot: float = 0.0  # part of the limit by which a loop may exceed it

    @property
    def exceeds(self) -> bool:
        """Beyond the limit, and the overshoot that is allowed."""
        return self.value > self.limit * (1 + self.overshoot)

    @property
    def is_near(self) -> bool:
        """Within the limit by less than a tenth, or beyond it by an overshoot."""
        return NEAR * self.limit <= self.value and not self.exceeds

    @property
    def words(self) -> str:
        """Value, limit and place."""
        size = f"{self.value:.4g} of {self.limit:.4g} {self.unit}"
        if self.hidden > RINGING * self.limit:
            size += f", {self.hidden:.3g} of it between samples: the control alternates"
        return f"{size} ({self.contour}, {self.plant})"


class Signals(NamedTuple):
    """Signals of runs on every plant along every contour, and the names of both.

    Attributes:
        output: tool [m].
        control: of every input.
        counted: samples whose peaks count.
        contours: names.
        plants: names.
        asked: motion that is followed [m], where its speed is compared with its limit.
    """

    output: Float[np.ndarray, "contours plants steps axes"]
    control: Float[np.ndarray, "contours plants steps inputs"]
    counted: Bool[np.ndarray, "contours steps"]
    contours: Sequence[str]
    plants: Sequence[str]
    asked: Float[np.ndarray, "contours steps axes"] | None = None


def limits_met(replay: Replay, scenarios: Scenarios, machine: Machine) -> list[str]:
    """One line for every machine limit that a run exceeds, meets or comes near."""
    peaks = list(_peaks(_replayed(replay, scenarios, scored(scenarios)), machine))
    rapids = drives_at_limits_in_rapids(replay, scenarios, machine)
    return [*_beyond(peaks), *rapids, *_near(peaks)]


def limit_warnings(replay: Replay, scenarios: Scenarios, machine: Machine) -> list[str]:
    """One line for every machine limit that a run meets to within 10 %."""
    return _near(_peaks(_replayed(replay, scenarios, scored(scenarios)), machine))


def exceeded_limits(replay: Replay, scenarios: Scenarios, machine: Machine) -> list[str]:
    """One line for every machine limit that a run exceeds where it is scored."""
    return _beyond(_peaks(_replayed(replay, scenarios, scored(scenarios)), machine))


def limits_not_kept(
    seen: Signals, machine: Machine, within: Bool[np.ndarray, " plants"]
) -> list[str]:
    """One line for every machine limit that a run exceeds, those of some plants before the others.

    Args:
        seen: the runs; one that diverged is left out.
        machine: with its limits.
        within: plants whose largest value is told where it exceeds a limit; else that of the rest.
    """
    lines: dict[tuple[str, str], str] = {}
    for chosen in (within, ~within):
        if not chosen.any():
            continue
        part = seen._replace(
            output=seen.output[:, chosen],
            control=seen.control[:, chosen],
            plants=[name for name, here in zip(seen.plants, chosen, strict=True) if here],
        )
        for one in _peaks(part, machine):
            if one.exceeds:
                lines.setdefault((one.quantity, one.name), _exceeding(one))
    return list(lines.values())


def beyond_limits_asked(
    position: Float[np.ndarray, "T m"],
    before: Float[np.ndarray, "T m"],
    machine: Machine,
    at_rest: bool,
) -> list[str]:
    """One line for every axis limit that a reference exceeds, and more than the one before it did.

    Its speed and acceleration are differences of its samples.

    Args:
        position: samples of the reference [m].
        before: of the one that it replaces [m].
        machine: with its limits.
        at_rest: whether both begin and end at rest.
    """
    asked, usual = (largest_asked(rows, machine.model.dt, at_rest) for rows in (position, before))
    lines = []
    for k, limit, quantity, unit in (
        (0, machine.limits.speed, "speed", "m/s"),
        (1, machine.limits.acceleration, "acceleration", "m/s^2"),
    ):
        if limit is None:
            continue
        for axis, name in enumerate(machine.axes):
            most = float(limit[axis])
            if asked[k][axis] > max(most, ROUNDING * usual[k][axis]):
                lines.append(
                    f"{quantity} of {name} that the reference asks for EXCEEDS its limit: "
                    f"{asked[k][axis]:.4g} of {most:.4g} {unit}"
                )
    return lines


def largest_asked(
    position: Float[np.ndarray, "T m"], dt: float, at_rest: bool
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Largest speed [m/s] and acceleration [m/s^2] that a reference asks of every axis.

    Its first step from rest and its last one to rest count, where it has them.
    """
    if at_rest:
        position = np.concatenate([position[:1], position, position[-1:]])
    speed, acceleration = measured_speeds(position, dt)
    return np.abs(speed).max(axis=0), np.abs(acceleration).max(axis=0)


def drives_at_limits_in_rapids(replay: Replay, scenarios: Scenarios, machine: Machine) -> list[str]:
    """One line for every limit of a drive that is met in rapid moves of programs.

    They are not scored, but a tool that falls behind there is late in the next cut. Speed and
    acceleration, which the motion itself takes to their limits, say nothing of this.
    """
    rapid = _rapid(scenarios)
    if not rapid.any():
        return []
    return [
        f"{one.quantity} of {one.name} is at its limit in a rapid move: {one.words}; a lower "
        "speed or acceleration in the limits of the machine keeps it below"
        for one in _peaks(_replayed(replay, scenarios, rapid), machine)
        if one.quantity in DRIVES and one.value >= MET * one.limit
    ]


def _near(peaks: Iterable[Peak]) -> list[str]:
    return [
        f"{one.quantity} of {one.name} is near its limit: {one.words}"
        if one.value <= one.limit
        else f"{one.quantity} of {one.name} overshoots its limit, which the motion itself keeps: "
        f"{one.words}"
        for one in peaks
        if one.is_near
    ]


def _beyond(peaks: Iterable[Peak]) -> list[str]:
    return [_exceeding(one) for one in peaks if one.exceeds]


def _exceeding(one: Peak) -> str:
    return f"{one.quantity} of {one.name} EXCEEDS its limit: {one.words}"


def _replayed(
    replay: Replay, scenarios: Scenarios, counted: Bool[np.ndarray, "contours steps"]
) -> Signals:
    """The signals of a replay; a run that diverged is not finite."""
    lost = np.asarray(replay.metrics.diverged)[..., None, None]
    output, control = (np.where(lost, np.nan, rows) for rows in (replay.output, replay.control))
    names = [job.name for job in scenarios.jobs]
    return Signals(output, control, counted, names, scenarios.plants, desired(scenarios))


def _rapid(scenarios: Scenarios) -> Bool[np.ndarray, "contours steps"]:
    """Which samples are of rapid moves: those of whole programs that do not count."""
    found = np.zeros((len(scenarios.jobs), scenarios.references.steps), bool)
    for row, job in zip(found, scenarios.jobs, strict=True):
        if isinstance(job, Job) and job.program is not None:
            row[: job.samples] = ~job.scored
    return found


def _peaks(seen: Signals, machine: Machine) -> Iterator[Peak]:
    """Peak of every limited quantity of every axis in the samples that are counted, and where.

    A run that is not finite is left out: its numbers mean nothing. To the largest acceleration that
    the samples show is added the largest that they hide.
    """
    lost = ~(_finite(seen.output) & _finite(seen.control))[..., None, None]
    output, control = (np.where(lost, 0.0, rows) for rows in (seen.output, seen.control))
    increment = np.diff(control, axis=-2)
    speed, acceleration = measured_speeds(output, machine.model.dt)
    unit, limits = machine.control_unit, machine.limits
    inputs = [f"input {k + 1}" for k in range(machine.model.inputs)]
    for limit, quantity, values, names, shown in (
        (limits.speed, "speed", speed, machine.axes, "m/s"),
        (limits.acceleration, "acceleration", acceleration, machine.axes, "m/s^2"),
        (limits.control, "control", control, inputs, unit),
        (limits.increment, "control increment", increment, inputs, f"{unit} per sample"),
    ):
        if limit is None:
            continue
        peaks = largest_counted(values, seen.counted)
        hidden = 0.0 * peaks
        if quantity == "acceleration":
            unseen = alternating(control) @ machine.hidden_acceleration.T
            hidden = largest_counted(np.asarray(unseen), seen.counted)
        peaks += hidden
        overshoot = 0.0 * limit
        if quantity == "speed" and seen.asked is not None:
            asked = np.abs(measured_speeds(seen.asked, machine.model.dt)[0]).max(axis=(0, 1))
            overshoot = np.where(asked <= (1 + PLAN_ROUNDING) * limit, OVERSHOOT, 0.0)
        for k, name in enumerate(names):
            place = np.unravel_index(np.argmax(peaks[:, :, k]), peaks.shape[:2])
            where = seen.contours[int(place[0])], seen.plants[int(place[1])]
            value, part = float(peaks[*place, k]), float(hidden[*place, k])
            allowed = float(overshoot[k])
            yield Peak(name, quantity, shown, value, *where, float(limit[k]), part, allowed)


def largest_counted(
    values: Float[np.ndarray, "contours plants rows axes"],
    counted: Bool[np.ndarray, "contours steps"],
) -> Float[np.ndarray, "contours plants axes"]:
    """Largest magnitude of differences whose samples are all counted."""
    whole = between_counted(counted, values.shape[2])
    return np.asarray(np.where(whole[:, None, :, None], np.abs(values), 0.0).max(axis=2))


def _finite(rows: np.ndarray) -> np.ndarray:
    """Which runs (contour, plant) are finite at every sample."""
    return np.asarray(np.isfinite(rows).all(axis=(2, 3)))


def between_counted(
    counted: Bool[np.ndarray, "contours steps"], rows: int
) -> Bool[np.ndarray, "contours rows"]:
    """Which of the `rows` differences (contour, row) are between counted samples alone."""
    apart = counted.shape[1] - rows
    windows = np.lib.stride_tricks.sliding_window_view(counted, apart + 1, axis=1)
    return np.asarray(windows.all(axis=-1))
