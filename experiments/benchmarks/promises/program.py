"""`jcontour bench program`: contour error of a long finishing program by law of motion.

The machine is `example.json` with its usual controller. Coordinates have three decimals of a
millimetre, as most CAM systems write them, or four. Motions of one row take the same time:
jerk-limited ones within a tolerance, and beside each of them constant feed through the raw chords.
Errors are those of the tool from the program's chords, and from the curve that the chords stand
for.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from rich.console import Console
from scipy.spatial import KDTree

from experiments.benchmarks.promises.finishing_program import Side, finishing_sides, gcode
from jcontour.app import machines
from jcontour.app.catalogue.choices import design_for, machine_named
from jcontour.app.designs.design import Design
from jcontour.app.flags.loops import Simulate
from jcontour.app.flags.others import Bench
from jcontour.app.jobs.job import Job, from_file
from jcontour.app.jobs.pace import Pace
from jcontour.app.jobs.replays import Scenarios, replay
from jcontour.app.reports import tables
from jcontour.motion.feed_laws import constant_feed

MACHINE = Path(machines.__file__).parent / "example.json"
CHORDS = 150_000
# decimals of the program, tolerance [um]
CASES = ((3, 2.0), (3, 1.5), (3, 1.2), (3, 1.0), (3, 0.8), (4, 2.0), (4, 1.0), (4, 0.5))
APART = 5e-6  # [m] of points on the curve: less than 0.01 um from it where it bends by 0.4 mm
NEAREST = 8  # points on the curve: near a corner those of both sides
ALIKE = 1e-3  # of a cycle time: equal
TRIES = 20


@dataclass(frozen=True)
class Row:
    """One motion.

    Attributes:
        law: by which it is planned.
        cycle_time: [s].
        peak: largest contour error of the nominal machine, from the program [m].
        rms: of it [m].
        worst: largest one of the machine's family [m].
        from_curve: largest distance of the nominal machine from the curve [m].
        control: largest control of the nominal machine, in the machine's unit.
    """

    law: str
    cycle_time: float
    peak: float
    rms: float
    worst: float
    from_curve: float
    control: float


@dataclass(frozen=True)
class ProgramBench:
    """Rows of the table, and what the first of them took.

    Attributes:
        chords: of the program.
        rows: jerk-limited motions, each before constant feed in its time; then trapezoidal ones.
        planning: seconds to read the program and to plan the first motion.
        simulating: seconds to run it on the whole family, with compiling.
    """

    chords: int
    rows: list[Row]
    planning: float
    simulating: float


@dataclass(frozen=True)
class _Table:
    """Machine and controller that run a program, and the curve that it stands for."""

    path: Path
    pace: Pace
    design: Design
    curve: KDTree

    def job(self, **changes) -> Job:
        """Run along the program at a changed pace."""
        return from_file(self.path, self.pace._replace(**changes))

    def row(self, law: str, job: Job) -> Row:
        """Errors of one motion."""
        machine = self.pace.machine
        design = self.design
        scenarios = Scenarios.of([job], [False], machine, design.fed, design.preview)
        found = replay(design.build(design.start), scenarios)
        error = np.linalg.norm(found.contour_error[0], axis=-1)  # (plant, time)
        away = _distance(self.curve, found.output[0, 0])
        return Row(
            law=law,
            cycle_time=(job.samples - 1) * machine.model.dt,
            peak=float(error[0].max()),
            rms=float(np.sqrt(np.mean(error[0] ** 2))),
            worst=float(error.max()),
            from_curve=float(away.max()),
            control=float(np.abs(found.control[0, 0]).max()),
        )


def measured(flags: Bench, tell: Callable[[str], None]) -> ProgramBench:
    """Every motion of the program one after the other."""
    sides = finishing_sides(flags.batch[0] if flags.batch else CHORDS)
    chords = sum(side.chords().size - 1 for side in sides)
    given = Simulate(plant=str(MACHINE))
    machine = machine_named(given.plant)
    rows, seconds = [], []
    with tempfile.TemporaryDirectory() as folder:
        curve, paths = _curve(sides), _written(sides, Path(folder))
        pace, design = Pace.of(given, machine), design_for(machine, given)
        for decimals, tolerance in CASES:
            table = _Table(paths[decimals], pace, design, curve)
            began = time.perf_counter()
            job = table.job(corner_tolerance=1e-6 * tolerance)
            planned = time.perf_counter()
            law = f"jerk-limited, {tolerance:g} um, {decimals} decimals"
            rows.append(table.row(law, job))
            seconds.append((planned - began, time.perf_counter() - planned))
            rows.append(table.row("constant feed", _constant(job, pace)))
            tell(f"{law}: {1e6 * rows[-2].peak:.3g} um")
        table = _Table(paths[CASES[0][0]], pace, design, curve)
        rows.append(table.row("trapezoidal", table.job(feed_law="trapezoidal")))
        rows.append(table.row("trapezoidal, slower", _slowed(table, rows[0].cycle_time)))
    return ProgramBench(chords, rows, *seconds[0])


def _written(sides: list[Side], folder: Path) -> dict[int, Path]:
    """Programs of the sides by their decimals."""
    paths = {decimals: folder / f"finishing-{decimals}.ngc" for decimals, _ in CASES}
    for decimals, path in paths.items():
        path.write_text(gcode(sides, decimals))
    return paths


def _constant(job: Job, pace: Pace) -> Job:
    """Constant feed through the raw chords, in the time of another run; nowhere at rest."""
    dt = pace.machine.model.dt
    feed = float(job.contour.length) / ((job.samples - 1) * dt)
    arc = constant_feed(job.contour, feed, dt)
    return Job(job.name, job.contour, arc, np.ones(arc.size, bool), False, "constant")


def _slowed(table: _Table, duration: float) -> Job:
    """Trapezoidal motion at a lower feed, which takes so long [s]; else the quickest."""
    low, high = 0.0, 1.0
    job = table.job(feed_law="trapezoidal")
    for _ in range(TRIES):
        lasting = (job.samples - 1) * table.pace.machine.model.dt
        if abs(lasting - duration) <= ALIKE * duration:
            break
        override = 0.5 * (low + high)
        job = table.job(feed_law="trapezoidal", override=override)
        later = (job.samples - 1) * table.pace.machine.model.dt > duration
        low, high = (override, high) if later else (low, override)
    return job


def _curve(sides: list[Side]) -> KDTree:
    """Points of the sides' curves, close together; a corner is one point, of both its sides."""
    points = [sides[0].at(np.zeros(1))]
    for side in sides:
        count = int(2 * np.linalg.norm(side.last - side.first) / APART)
        points.append(side.at(np.linspace(0.0, 1.0, count)[1:]))
    return KDTree(np.concatenate(points))


def _distance(curve: KDTree, place: Float[np.ndarray, "T 2"]) -> Float[np.ndarray, " T"]:
    """Distance of places from the lines between neighbouring points of the curve [m]."""
    points = np.asarray(curve.data)
    _, nearest = curve.query(place, min(NEAREST, len(points)))
    least = np.full(len(place), np.inf)
    for first in np.concatenate([nearest - 1, nearest], axis=1).T.clip(0, len(points) - 2):
        begin, along = points[first], points[first + 1] - points[first]
        share = np.sum((place - begin) * along, axis=1) / np.maximum(
            np.sum(along**2, axis=1), 1e-30
        )
        foot = begin + np.clip(share, 0.0, 1.0)[:, None] * along
        least = np.minimum(least, np.linalg.norm(place - foot, axis=1))
    return least


def show(console: Console, result: ProgramBench) -> None:
    """A line for every motion; constant feed has its ratio to the motion before it."""
    cells = []
    for k, row in enumerate(result.rows):
        ratio = ["", ""]
        if row.law == "constant feed":
            before = result.rows[k - 1]
            ratio = [f"{row.peak / before.peak:.1f}", f"{row.from_curve / before.from_curve:.1f}"]
        cells.append(
            [
                row.law,
                f"{row.cycle_time:.2f}",
                *(f"{1e6 * value:.2f}" for value in (row.peak, row.rms, row.worst, row.from_curve)),
                f"{row.control:.3g}",
                *ratio,
            ]
        )
    columns = ["motion", "s", "peak", "RMS", "worst", "from curve", "control", "times", "times"]
    title = f"Finishing program of {result.chords} chords, errors in um"
    console.print(tables.plain_table(title, columns, cells, text_columns=1))
    tables.say(
        console,
        "peak, RMS: of the nominal machine, from the program; worst: peak of its family; from "
        "curve: peak from the curve that the chords stand for; times: constant feed over the "
        "motion before it, from the program and from the curve",
        f"read and planned in {result.planning:.3g} s, run on the family in "
        f"{result.simulating:.3g} s with compiling",
    )
