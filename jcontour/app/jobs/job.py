"""Runs of a machine along a contour, and motions of a single axis.

A run says how fast the tool goes along the contour, and which samples are scored.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jcontour.app.files.checks import named
from jcontour.app.jobs.pace import Pace, TooLongError, check_duration
from jcontour.app.plain_numbers import feed_words
from jcontour.geometry.contour import Contour, unpadded
from jcontour.geometry.toolpath_rules import DRAWINGS, ToolpathError
from jcontour.motion import Reference, SharpTurnError, along, constant_feed, in_time
from jcontour.motion.references import TimeLaw

if TYPE_CHECKING:  # a contour at constant feed needs neither programs nor their motions
    from jcontour.app.jobs.motion_laws import Aside
    from jcontour.geometry.toolpaths import Toolpath
    from jcontour.motion import Planned

# times the fastest feed, where the machine states no speed; rapid moves are traced but not scored
RAPID = 3.0
ENTRY = 100  # samples; a tuned loop has caught up by then, a slow cascade not all the way
SETTLING = 0.25  # [s] after a motion: five time constants of a position loop of 20 1/s
ROUNDING = 1e-12  # of a contour's length
STILL = 1e-9  # [m] and of the way: an axis that moves less stands still
TOOLPATHS = Path(__file__).parent / "toolpaths"


class Job(NamedTuple):
    """One run along a contour: its motion, and the last point held until the tool has settled."""

    name: str  # for tables and files
    contour: Contour  # the path
    arc: np.ndarray  # arc length at every sample of the motion [m]
    # whether every sample counts in the metrics; the held ones count as the last does
    scored: np.ndarray
    at_rest: bool  # from rest to rest
    feed_law: str  # in words
    # file behind it, with what its motion warns of; None where there is none
    program: "Toolpath | None" = None
    # where it leaves the contour, in blended corners; None where it does not
    aside: "Aside | None" = None
    planned: "Planned | None" = None  # jerk-limited motion behind it; None where there is none
    settling: int = 0  # samples of the last point that are held after the motion

    @property
    def samples(self) -> int:
        """Control steps of the motion."""
        return self.arc.size

    @property
    def steps(self) -> int:
        """Control steps of the run, those of settling included."""
        return self.samples + self.settling

    @property
    def counted(self) -> np.ndarray:
        """Whether every control step (steps,) counts in the metrics."""
        return np.pad(self.scored, (0, self.settling), mode="edge")

    @property
    def rapid(self) -> np.ndarray:
        """(P,) which pieces of the contour are rapid moves."""
        if self.program is None:
            return np.zeros(np.asarray(self.contour.mask).sum(), bool)
        return self.program.rapid

    def line_at(self, sample: int) -> int | None:
        """Line of the file that the run is on; None where there is no file or it does not say."""
        if self.program is None:
            return None
        last = min(sample, self.samples - 1)  # it settles on the line that it came to
        return int(self.program.line[_piece_at(self.contour, self.arc[last])]) or None

    def reference(self, dt: float, preview: int) -> Reference:
        """Samples of the run, with `preview` more appended."""
        if preview > self.arc.size:
            raise ValueError(
                f"preview: {preview} samples are more than the {self.arc.size} "
                f"of the whole run along {self.name}"
            )
        arc = np.pad(self.arc, (0, self.settling), mode="edge")
        reference = along(self.contour, arc, dt, preview, self.at_rest, self.counted)
        return reference if self.aside is None else reference.aside(*self.aside.held(self.settling))


class AxisMove(NamedTuple):
    """A run of a single axis from one end of a line to the other, by a law of time."""

    name: str
    contour: Contour
    law: TimeLaw
    duration: float
    dwell: float
    dt: float
    feed_law: str
    program: None = None  # it comes from none

    @property
    def samples(self) -> int:
        """Control steps of the run, which rests at its end."""
        return round(self.duration / self.dt) + 1

    @property
    def steps(self) -> int:
        """The same."""
        return self.samples

    def line_at(self, sample: int) -> None:
        """None: it comes from no program."""
        return None

    def reference(self, dt: float, preview: int) -> Reference:
        """Samples of the run, with `preview` more appended."""
        return in_time(self.contour, self.law, self.duration, dt, preview, self.dwell)


Task = Job | AxisMove


def behind_entry(samples: int) -> Bool[np.ndarray, " T"]:
    """Which samples of a run in motion are scored: those behind its entry.

    The tool stands where such a run begins, and the reference is at full feed. What the loop does
    until it has caught up says nothing of the contour.

    >>> behind_entry(250).sum(), behind_entry(60).sum()
    (np.int64(150), np.int64(30))

    Args:
        samples: of the whole run; of a short one the entry is at most half.
    """
    return np.arange(samples) >= min(ENTRY, samples // 2)


def at_constant_feed(name: str, contour: Contour, pace: Pace) -> Job:
    """Run in motion from the first sample; its entry is not scored.

    A closed contour is run twice and scored the second time. An open one is scored behind the entry
    of `behind_entry`.
    """
    contour = _on_axes(name, contour, pace)
    dt, feed = pace.machine.model.dt, pace.override * pace.feed_or_default
    arc = constant_feed(contour, feed, dt)
    scored = behind_entry(arc.size)
    if bool(contour.closed):
        arc = feed * dt * np.arange(int(2 * float(contour.length) / (feed * dt)) + 1)
        scored = arc >= float(contour.length)
    return Job(name, contour, arc, scored, False, f"constant {feed_words(feed)}")


def along_contour(name: str, contour: Contour, pace: Pace) -> Job:
    """Run at the pace's feed: constant, or by its feed law where the machine states acceleration.

    Such a machine passes no sharp corner at feed.
    """
    if pace.axis_acceleration is None:
        return at_constant_feed(name, contour, pace)
    contour = _on_axes(name, contour, pace)
    return from_rest_to_rest(name, contour, pace, pace.override * pace.feed_or_default)


def from_rest_to_rest(name: str, contour: Contour, pace: Pace, feed: float) -> Job:
    """Run by the pace's feed law at one feed [m/s]; every sample is scored."""
    from jcontour.app.jobs.motion_laws import along_path

    pieces = contour.rate.shape
    on = np.full(pieces, np.nan)
    run = along_path(contour, np.full(pieces, feed), np.zeros(pieces, bool), pace, on)
    return Job(
        name,
        contour,
        run.arc,
        np.ones(run.arc.size, bool),
        True,
        run.words,
        aside=run.aside,
        planned=run.planned,
        settling=settling_samples(pace.machine.model.dt),
    )


def settling_samples(dt: float) -> int:
    """Samples of `SETTLING`, at least one."""
    return max(1, round(SETTLING / dt))


def from_file(path: Path, pace: Pace) -> Job:
    """From rest to rest along a toolpath file: .csv points, a drawing, or else G-code.

    Raises:
        ToolpathError: as `read_csv`, `read_drawing` and `read_gcode`, or the file has another
            number of axes than the machine.
    """
    with named(path, ToolpathError):  # faults of the motion, too
        return _read(path, pace)


def _read(path: Path, pace: Pace) -> Job:
    from jcontour.app.jobs.motion_laws import along_path
    from jcontour.geometry.reading import read

    machine = pace.machine
    if machine.model.axes == 1:
        raise ToolpathError(f"needs a machine of two or three axes, {machine.name} has one")
    axes = "XY" if pace.machine.model.axes == 2 else "XYZ"
    feed = pace.feed_or_default if path.suffix.lower() in (".csv", *DRAWINGS) else pace.feed
    toolpath = read(path, feed, axes, pace.drawing_unit, pace.join, pace.tools)
    contour, rapid = _lifted(toolpath.contour, machine.model.axes), toolpath.rapid
    if contour.axes != machine.model.axes:
        raise ToolpathError(f"has {contour.axes} axes, the machine has {machine.model.axes}")
    z_alone = toolpath.z_alone / pace.override
    if pace.control is not None and toolpath.tolerance is not None:
        pace = pace._replace(control=pace.control._replace(tolerance=toolpath.tolerance))
    # Rapid moves are as fast as the machine, which no program says
    feeds, most = pace.override * toolpath.feed, pace.axis_speed
    fastest = float(np.nanmax(np.where(rapid, np.nan, feeds)))
    quickest = RAPID * fastest if most is None else max(fastest, float(most.max()))
    speed = np.where(rapid, quickest, feeds)
    try:
        check_duration(
            np.asarray(contour.extent) / speed, np.nan_to_num(toolpath.rest), z_alone, machine
        )
        run = along_path(contour, speed, rapid, pace, toolpath.rest + z_alone)
    except (TooLongError, SharpTurnError) as error:
        raise ToolpathError(f"line {toolpath.line[error.piece]}: {error}") from None
    # As `_piece_at`, but at a joint the piece that ends: who rests there is still in the work
    before, at = (
        _piece_at(contour, run.arc - 2 * ROUNDING * float(contour.length)),
        _piece_at(contour, run.arc),
    )
    scored = ~(rapid[before] & (rapid[at] | (z_alone[before] > 0)))
    said = _warnings(path, toolpath, contour, speed, pace, run.planned is not None)
    return Job(
        path.stem,
        contour,
        run.arc,
        scored,
        True,
        run.words,
        toolpath._replace(warnings=(*toolpath.warnings, *said)),
        run.aside,
        run.planned,
        settling_samples(machine.model.dt),
    )


def _warnings(
    path: Path,
    read: "Toolpath",
    contour: Contour,
    speed: Float[np.ndarray, " P"],
    pace: Pace,
    planned: bool,
) -> Iterator[str]:
    """What to know of a motion along a file at these speeds [m/s], jerk-limited where planned."""
    from jcontour.app.jobs.motion_laws import UM, coarse_coordinates

    machine, rapid, suffix = pace.machine, read.rapid, path.suffix.lower()
    if pace.drawing_unit is not None and suffix not in DRAWINGS:
        own = "points are read in mm" if suffix == ".csv" else "a program says its own"
        yield f"--drawing-unit does not act on {path.name}: {own}"
    if rapid.any():
        limit, asked = pace.axis_speed, speed[rapid].max()
        why = f"{RAPID:g} times the fastest feed: the machine states no speed"
        if limit is not None:
            limited = asked <= limit.max()
            why = (
                "the machine's limit of speed" if limited else "the fastest feed, above that limit"
            )
        yield f"rapid moves at {feed_words(asked)} ({why})"
    yield from pace.warnings
    # A tolerance of the program, or of its coordinates, that is not the one of the motion
    used, allowed = f"{pace.corner_tolerance / UM:.4g} um", read.tolerance
    if planned and pace.override == 1.0:
        if allowed is not None and not np.isclose(allowed, pace.corner_tolerance):
            flag = f"--corner-tolerance-um {allowed / UM:.4g}"
            yield f"the program allows {allowed / UM:.4g} um (P of G64), {used} are used: {flag}"
        elif coarse := coarse_coordinates(contour, speed, ~rapid, pace):
            yield (
                f"coordinates are rounded to {coarse.step / UM:.4g} um, the tolerance is {used}: "
                f"{coarse.moves} short moves cannot be smoothed; --corner-tolerance-um "
                f"{coarse.step / UM:.4g} smooths them; more digits need not leave the part"
            )
    pieces = unpadded(contour)
    moves = (np.abs(pieces.polynomial[:, 1:]) > STILL).any(axis=(0, 1))
    moves |= (np.abs(np.concatenate([pieces.cosine, pieces.sine])) > STILL).any(axis=0)
    if moves.sum() == 1:
        still = [name for name, one in zip(machine.axes, moves, strict=True) if not one]
        yield f"{' and '.join(still)} never move{'s' if len(still) == 1 else ''}"


def _piece_at(contour: Contour, arc: np.ndarray) -> np.ndarray:
    """Number of the piece that the contour is on at every arc length [m]; at a joint the next."""
    reached = arc + ROUNDING * float(contour.length)
    started = np.searchsorted(np.asarray(contour.start), reached, side="right")
    return np.clip(started - 1, 0, contour.rate.size - 1)


def _on_axes(name: str, contour: Contour, pace: Pace) -> Contour:
    """The contour on all axes of the pace's machine."""
    machine, axes = pace.machine.name, pace.machine.model.axes
    if contour.axes > axes:
        raise ValueError(f"contour: {name} needs {contour.axes} axes, {machine} has {axes}")
    return _lifted(contour, axes)


def _lifted(contour: Contour, axes: int) -> Contour:
    """The contour in the plane z = 0 of a three-axis machine."""
    if contour.axes >= axes:
        return contour
    return eqx.tree_at(
        lambda c: (c.polynomial, c.cosine, c.sine),
        contour,
        replace_fn=lambda rows: jnp.concatenate(
            [rows, jnp.zeros((*rows.shape[:-1], 1), rows.dtype)], axis=-1
        ),
    )
