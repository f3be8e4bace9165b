"""A run that was measured: the path of its part, commands and tool along it."""

from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from jcontour.app.catalogue.choices import job_named, machine_named
from jcontour.app.catalogue.entries import CONTOURS
from jcontour.app.files.log_file import Log
from jcontour.app.jobs.job import Job, Pace
from jcontour.app.reports.tables import position
from jcontour.geometry.contour import Contour, outline
from jcontour.geometry.contours import polyline
from jcontour.geometry.reading import read
from jcontour.motion.references import Reference, from_samples
from jcontour.simulation.metrics import contour_error

MEASURED = "measured"
FARTHEST = 0.02  # of the part's size: commands farther from it are on their way to it
MOSTLY = 0.8  # of the commands between the first on the part and the last
CHUNK = 1000  # samples, whose nearest points are sought at once
ROUNDS = 4  # for the zero of the part
SHIFTED = 1e-3  # of the part's size: the log has another zero
MOST = 400_000  # samples
FEWEST = 20  # samples in motion: twice as many as causes have coefficients
STILL = 1e-6  # [m] of travel
FOLLOWS = 0.5  # correlation of a position with its command, at least
UNLIKE = 2.0  # ratio of the two that is one of units
FED = 1.0  # [m/s] of points and drawings; no error depends on it


class MeasuredRun(NamedTuple):
    """A record along a path."""

    job: Job  # the path, and which samples count
    reference: Reference  # the commands as a reference along it
    command: np.ndarray  # (T, m) [m]
    tool: np.ndarray  # (T, m) [m]
    words: list[str]  # what was done to the record

    def error(self, tool: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contour errors of tool points (T, m) [m], and unit tangents where they are nearest.

        On one axis the error is that of following, and the tangent means nothing.
        """
        if tool.shape[1] == 1:
            return tool - self.command, np.ones_like(tool)
        error = np.asarray(contour_error(tool, self.reference))
        reach = 1e-6 + 2 * np.linalg.norm(tool - error - self.command, axis=1)
        contour = self.reference.contour
        arc = contour.nearest(tool - error, self.reference.arc, reach)
        return error, np.asarray(contour.tangent(arc))


def measured_run(log: Log, name: str, part: str | None, axes: tuple[str, ...]) -> MeasuredRun:
    """The run of a log, along its part or along its commands."""
    if len(log.command) > MOST:
        raise ValueError(f"{name}: has {len(log.command)} samples, more than {MOST}: take a part")
    moves = np.append(np.linalg.norm(np.diff(log.command, axis=0), axis=1) > 0, False)
    if moves.sum() < FEWEST or np.ptp(log.command, axis=0).max() <= STILL:
        raise ValueError(
            f"{name}: the commands do not move, in {FEWEST} samples at least, by more than "
            f"{1e6 * STILL:g} um; are they the right columns, in the right unit?"
        )
    if part is not None and len(axes) == 1:
        raise ValueError("part: one axis follows its command and no path; leave --part out")
    _check_columns(name, log, axes)
    if part is None:
        first = np.append(True, moves[:-1])
        path, rapid, program = polyline(log.command[first]), np.zeros(first.sum() - 1, bool), None
        command, tool, words = log.command, log.position, list[str]()
        steps = np.linalg.norm(np.diff(command, axis=0), axis=1)
        arc = np.concatenate([[0.0], np.cumsum(steps)])
    else:
        if part in CONTOURS:
            known = job_named(part, Pace(machine_named("bridgeport"), None, None))
            assert isinstance(known, Job)
            name, path, rapid, program = known.name, known.contour, known.rapid, known.program
        else:
            program = read(part, FED, "XY" if len(axes) == 2 else "XYZ")
            name, path, rapid = Path(part).stem, program.contour, program.rapid
        offset = _offset(path, log.command)
        keep = _along(part, path, log.command - offset)
        command, tool, moves = (one[keep] for one in (log.command, log.position, moves))
        command, tool = command - offset, tool - offset
        moved = f"the part is at {position(axes, offset.tolist())} of the log"
        words = [moved] if offset.any() else []
        along = from_samples(command, _tangents(command), log.dt, 0, path, tolerance=np.inf)
        arc = np.asarray(along.arc)
        if np.ptp(arc) < (1 - FARTHEST) * path.length:
            words.append(f"the log has {100 * np.ptp(arc) / path.length:.0f} % of the part alone")
    pieces = np.searchsorted(np.asarray(path.start), arc, side="right") - 1
    scored = ~rapid[np.clip(pieces, 0, len(rapid) - 1)]
    moving = np.flatnonzero(moves)
    scored[: moving[0]] = scored[moving[-1] + 2 :] = False
    reach = np.abs(tool - command).max() if path.axes > 1 and not path.closed else 0.0
    if moving[0] == 0:  # a record that begins or ends in motion has no path around its ends
        scored &= arc > arc[0] + reach
    if moving[-1] >= len(command) - 2:
        scored &= arc < arc[-1] - reach
    samples = jax.device_put((command, _tangents(command), arc, scored, 0 * command[0]))
    reference = Reference(*samples, path, log.dt, len(command))
    job = Job(name, path, arc, scored, True, MEASURED, program)
    return MeasuredRun(job, reference, command, tool, words)


def _check_columns(name: str, log: Log, axes: tuple[str, ...]) -> None:
    """Refuse positions that are not those of their commands."""
    asked, seen = (one - one.mean(axis=0) for one in (log.command, log.position))
    size = np.linalg.norm(asked, axis=0), np.linalg.norm(seen, axis=0)
    moving = np.ptp(log.command, axis=0) > STILL
    with np.errstate(divide="ignore", invalid="ignore"):
        alike = np.nan_to_num(asked.T @ seen / np.outer(*size))
    for k in np.flatnonzero(moving):
        if not size[1][k]:
            raise ValueError(f"{name}: the position of {axes[k]} stands still, its command moves")
        best = int(np.argmax(alike[k]))
        if alike[k, best] > FOLLOWS and alike[k, k] < FOLLOWS:
            raise ValueError(
                f"{name}: the command of {axes[k]} is followed by the position of {axes[best]}: "
                "change their columns"
            )
        if alike[k, k] < FOLLOWS:
            raise ValueError(
                f"{name}: the position of {axes[k]} does not follow its command (correlation "
                f"{alike[k, k]:.2g}): are both columns positions of this axis?"
            )
        ratio = float(size[1][k] / size[0][k])
        if not 1 / UNLIKE < ratio < UNLIKE:
            raise ValueError(
                f"{name}: the position of {axes[k]} goes {ratio:.3g} times as far as its command: "
                "are they in the same unit? x_command_mm and x_position_um say theirs"
            )


def _offset(path: Contour, command: np.ndarray) -> np.ndarray:
    """Zero of the part in the log [m], by the boxes around both; none where it is the log's."""
    box = outline(path)
    low, high = box.min(axis=0), box.max(axis=0)
    size = float(np.linalg.norm(high - low))
    below, above = command.min(axis=0) - low, command.max(axis=0) - high
    alike = np.abs(above - below).max() < FARTHEST * size
    offset = (below + above) / 2
    if not alike or np.abs(offset).max() <= SHIFTED * size:
        return np.zeros(len(low))
    for _ in range(ROUNDS):  # blended corners are not on the part: the nearer half counts
        nearest = _nearest(path, command - offset)
        apart = command - offset - np.asarray(path.position(nearest))
        tangent = np.asarray(path.tangent(nearest))
        near = np.linalg.norm(apart, axis=1)
        near = near <= np.median(near)
        across = np.eye(len(low)) - tangent[near, :, None] * tangent[near, None, :]
        offset = offset + np.linalg.lstsq(across.sum(axis=0), apart[near].sum(axis=0))[0]
    return offset


def _nearest(path: Contour, places: np.ndarray) -> np.ndarray:
    parts = np.array_split(places, -(-len(places) // CHUNK))
    return np.concatenate([np.asarray(path.nearest_anywhere(part)) for part in parts])


def _along(name: str, path: Contour, command: np.ndarray) -> slice:
    """Samples from the first on the part to the last."""
    nearest = np.asarray(path.position(_nearest(path, command)))
    distance = np.linalg.norm(command - nearest, axis=1)
    near = np.flatnonzero(distance <= FARTHEST * float(path.size))
    if near.size < 3 or near.size < MOSTLY * (near[-1] - near[0] + 1):
        raise ValueError(
            f"{name}: the commands are up to {1e3 * distance.max():.4g} mm from this part, "
            f"{1e3 * distance.min():.4g} mm at least; is it the part of the log, in the same unit, "
            "with its zero where the log has it?"
        )
    return slice(int(near[0]), int(near[-1]) + 1)


def _tangents(command: np.ndarray) -> np.ndarray:
    """Unit vectors along the motion, kept while it rests."""
    steps = np.gradient(command, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    moving = np.flatnonzero(sizes > 0)
    last = np.maximum(np.searchsorted(moving, np.arange(len(command)), side="right") - 1, 0)
    return (steps / np.maximum(sizes, 1e-300)[:, None])[moving[last]]
