"""Runs of a machine along a contour, and motions of a single axis.

A run says how fast the tool goes along the contour, and which samples are scored.
"""

from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from experiments.machines.machine import Machine
from experiments.shared_options import MachineFlags
from jcontour.geometry.contour import Contour
from jcontour.geometry.toolpaths import ToolpathError, read_csv, read_gcode
from jcontour.motion.feed_laws import constant_feed, trapezoidal
from jcontour.motion.references import Reference, TimeLaw, along, in_time

FEED = 3000.0  # [mm/min] where nothing is programmed
MM_PER_MIN = 1e-3 / 60
# [m/s^2] of a path where the machine states none: usual for a table of this size
ACCELERATION = 2.0
# of the acceleration that a machine states, that a motion asks for: fast loops take 1.8 times what
# a step of acceleration asks (`example.json`, its bracket and held-out contours, whole family)
SHARE = 0.5
# times the fastest feed, where the machine states no speed; rapid moves are traced but not scored
RAPID = 3.0
MOST_SAMPLES = 20_000_000  # of a run: each has hundreds of bytes
TOOLPATHS = Path(__file__).parent / "toolpaths"


class Pace(NamedTuple):
    """Feed [m/s] and path acceleration [m/s^2] on a machine with its limits.

    Each is None where it is not given.
    """

    machine: Machine
    feed: float | None
    acceleration: float | None

    @property
    def feed_or_default(self) -> float:
        """Feed [m/s] of contours that have no programme."""
        return FEED * MM_PER_MIN if self.feed is None else self.feed

    @property
    def acceleration_or_default(self) -> float:
        """Path acceleration [m/s^2]; where none is given, half of what the machine can do."""
        if self.acceleration is not None:
            return self.acceleration
        limit = self.axis_acceleration
        return ACCELERATION if limit is None else float(limit.min())

    @property
    def axis_acceleration(self) -> np.ndarray | None:
        """Acceleration [m/s^2] that a motion may ask of each axis; None where none is stated.

        All that the machine has, where the path acceleration is given.
        """
        limit = self.machine.limits.acceleration
        if limit is None or self.acceleration is not None:
            return limit
        return SHARE * limit

    @classmethod
    def of(cls, flags: MachineFlags, machine: Machine) -> "Pace":
        """Pace that the flags ask for.

        Raises:
            ValueError: a feed or acceleration that is not finite and above zero.
        """
        for name, value in (
            ("feed-mm-per-min", flags.feed_mm_per_min),
            ("acceleration", flags.acceleration),
        ):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name}: needs to be finite and above zero, received {value}")
        feed = None if flags.feed_mm_per_min is None else flags.feed_mm_per_min * MM_PER_MIN
        return cls(machine, feed, flags.acceleration)


class Program(NamedTuple):
    """G-code that a contour comes from.

    Attributes:
        line: (P,) line of the program that every piece is from.
        ignored: its words that mean nothing for the path.
    """

    line: np.ndarray
    ignored: tuple[str, ...]


class Job(NamedTuple):
    """One run along a contour, from the first to the last sample.

    Attributes:
        name: for tables and files.
        contour: the path.
        arc: arc length at every sample [m].
        scored: whether every sample counts in the metrics.
        at_rest: from rest to rest.
        feed_law: in words.
        program: G-code behind it; None where there is none.
    """

    name: str
    contour: Contour
    arc: np.ndarray
    scored: np.ndarray
    at_rest: bool
    feed_law: str
    program: Program | None = None

    @property
    def samples(self) -> int:
        """Control steps of the run."""
        return self.arc.size

    @property
    def ignored(self) -> tuple[str, ...]:
        """Words of the program that mean nothing for the path."""
        return () if self.program is None else self.program.ignored

    def line_at(self, sample: int) -> int | None:
        """Line of the program that the run is on; None where there is no program."""
        if self.program is None:
            return None
        return int(self.program.line[_piece_at(self.contour, self.arc[sample])])

    def reference(self, dt: float, preview: int) -> Reference:
        """Samples of the run, with `preview` more appended.

        Raises:
            ValueError: as `references.along`, or the run is shorter than the preview.
        """
        if preview > self.arc.size:
            raise ValueError(
                f"preview: {preview} samples are more than the {self.arc.size} "
                f"of the whole run along {self.name}"
            )
        return along(self.contour, self.arc, dt, preview, self.at_rest, self.scored)


class AxisMove(NamedTuple):
    """A run of a single axis from one end of a line to the other, by a law of time."""

    name: str
    contour: Contour
    law: TimeLaw
    duration: float
    dwell: float
    dt: float
    feed_law: str

    @property
    def samples(self) -> int:
        """Control steps of the run."""
        return round(self.duration / self.dt) + 1

    @property
    def ignored(self) -> tuple[str, ...]:
        """Nothing: it comes from no program."""
        return ()

    def line_at(self, sample: int) -> None:
        """None: it comes from no program."""
        return None

    def reference(self, dt: float, preview: int) -> Reference:
        """Samples of the run, with `preview` more appended.

        Raises:
            ValueError: as `references.in_time`.
        """
        return in_time(self.contour, self.law, self.duration, dt, preview, self.dwell)


Task = Job | AxisMove


def at_constant_feed(name: str, contour: Contour, pace: Pace) -> Job:
    """Run in motion from the first sample.

    A closed contour is run twice and scored the second time, when the entry has died out.
    """
    machine, axes = pace.machine.name, pace.machine.model.axes
    if contour.axes > axes:
        raise ValueError(f"contour: {name} needs {contour.axes} axes, {machine} has {axes}")
    contour = _lifted(contour, axes)
    dt, feed = pace.machine.model.dt, pace.feed_or_default
    arc = constant_feed(contour, feed, dt)
    laps = 2 if bool(contour.closed) else 1
    if laps == 2:
        arc = feed * dt * np.arange(int(laps * float(contour.length) / (feed * dt)) + 1)
    scored = arc >= (laps - 1) * float(contour.length)
    return Job(name, contour, arc, scored, False, f"constant {feed / MM_PER_MIN:.4g} mm/min")


def from_file(path: Path, pace: Pace) -> Job:
    """From rest to rest along a toolpath file, .csv points or G-code.

    Raises:
        ToolpathError: as `read_gcode` and `read_csv`, or the file has another number of axes than
            the machine.
    """
    try:
        return _read(path, pace)
    except ToolpathError as error:
        text = str(error)
        raise ToolpathError(text if str(path) in text else f"{path}: {text}") from None


def _read(path: Path, pace: Pace) -> Job:
    machine = pace.machine
    if machine.model.axes == 1:
        raise ToolpathError(f"needs a machine of two or three axes, {machine.name} has one")
    if path.suffix.lower() == ".csv":
        contour = _lifted(read_csv(path), machine.model.axes)
        if contour.axes != machine.model.axes:
            raise ToolpathError(f"has {contour.axes} axes, the machine has {machine.model.axes}")
        feed = np.full(contour.rate.shape, pace.feed_or_default)
        rapid = np.zeros(contour.rate.shape, bool)
        program = None
    else:
        axes = "XY" if machine.model.axes == 2 else "XYZ"
        contour, feed, rapid, line, ignored = read_gcode(path, axes, pace.feed)
        program = Program(line, ignored)
    fastest = float(np.nanmax(np.where(rapid, np.nan, feed)))
    speed = machine.limits.speed
    rapid_speed = RAPID * fastest if speed is None else max(fastest, float(speed.max()))
    speeds = np.where(rapid, rapid_speed, feed)
    _check_duration(float(np.sum(np.asarray(contour.extent) / speeds)), machine.model.dt)
    arc = trapezoidal(
        contour,
        speeds,
        machine.model.dt,
        pace.acceleration_or_default,
        speed,
        pace.axis_acceleration,
    )
    scored = ~rapid[_piece_at(contour, arc)]
    feed_law = f"trapezoidal, {fastest / MM_PER_MIN:.4g} mm/min"
    return Job(path.stem, contour, arc, scored, True, feed_law, program)


def _check_duration(least: float, dt: float) -> None:
    """Refuse what takes so long [s] that its samples do not fit in memory."""
    if least / dt > MOST_SAMPLES:
        raise ToolpathError(
            f"takes {least:.3g} s at least, more than {MOST_SAMPLES:,} samples of {dt:g} s: "
            "give a higher feed"
        )


def _piece_at(contour: Contour, arc: np.ndarray) -> np.ndarray:
    """Number of the piece that the contour is on at every arc length [m]."""
    started = np.searchsorted(np.asarray(contour.start), arc, side="right")
    return np.clip(started - 1, 0, contour.rate.size - 1)


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
