"""`jcontour bench whole_way`: from the record of a hidden machine to the contour error on it.

The machines are those of `true_machines`, outside the class of any model here. Each runs what
`--excite` writes; `identify`, `tune` and the loop on the machine itself follow. Of what ends in USE
the true loop may be unstable, ring or have a large Ms; its contour error is set beside the worst
that was printed (at the encoder) and that of the loop that recorded (at the tool).
"""

import json
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments.benchmarks.records.true_machines import (
    INNER,
    Law,
    TrueAxis,
    TrueRun,
    response,
    stepped,
)
from experiments.benchmarks.stored_results import kept
from experiments.tables import Column, Table
from jcontour.analysis.uncertain_loops import GRID, Lines, ResponseUncertainty
from jcontour.app.commands.tuning import tune
from jcontour.app.files.results.tuned_result import TunedResult
from jcontour.app.flags.others import Bench
from jcontour.app.flags.tuning import Tune
from jcontour.app.jobs.excitation import Excited, program
from jcontour.app.machines.identified import machine_fields
from jcontour.app.machines.machine_behaviour import response as model_response
from jcontour.app.reports.tables import console_of
from jcontour.app.runs.loops.bending import with_held_end
from jcontour.app.runs.stored_loops import stored_tuning
from jcontour.app.runs.tuning.limits import measured_peak
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.simulation.closed_loop import prepared
from jcontour.simulation.metrics import score_signals
from tuning.identification.linear.machine import identify_machine
from tuning.identification.linear.machine_record import MachineRecord

MOST_POLES, MOST_DELAY = 5, 10
PERIODS = (1e-3, 0.25e-3)  # [s]
TRAVEL, SPEED, ACCELERATION = 0.4, 0.25, 4.0
STEP_LAG = 50e-6  # [s] of a current loop that hardly lags
USE = "USE THESE VALUES"
NOISE = 0.3  # of a count
REST = 4.0  # [s] behind a contour: in its second half nothing may move on
RINGS = 3.0  # counts, peak to peak half, at the end of it
KNOCK = 1e-5  # [m] from which a linear loop has to come back
GROWN = 1.001  # of the motion a tenth of the run before: more grows
SAFE, RMS, PEAK = 3.0, 1.15, 1.3  # asked of USE: Ms, and errors over the printed worst


@dataclass(frozen=True)
class Way:
    """One hidden machine."""

    # seed, kind: which one, in words
    seed: int
    kind: str
    verdict: str  # of `tune`, or why there is none
    reasons: str  # against it
    stable: bool = False  # the true loop, without friction, gap and counts: back from a knock
    rings: float = nan  # largest motion at rest after a contour [m]
    sensitivity: float = nan  # Ms on the true response
    # rms, peak: largest contour error at the encoder over the printed worst, of all contours
    rms: float = nan
    peak: float = nan
    # recorded_um, tuned_um: largest RMS contour error at the tool, of all contours, under the
    # cascade or the position command that recorded and under what `tune` exports
    recorded_um: float = nan
    tuned_um: float = nan
    shown: float = nan  # frequency up to which the response was shown [Hz]
    printed_um: float = nan  # RMS contour error of the family's worst, of all contours

    @property
    def fails(self) -> str:
        """What is wrong with a machine that ends in USE; empty where nothing is."""
        wrong = {
            "unstable": not self.stable,
            "rings": not self.rings <= 1,
            f"Ms {self.sensitivity:.2f}": not self.sensitivity <= SAFE,
            f"RMS x {self.rms:.2f}": not self.rms <= RMS,
            f"peak x {self.peak:.2f}": not self.peak <= PEAK,
        }
        return ", ".join(name for name, bad in wrong.items() if bad)


def hidden_axis(random: np.random.Generator, takes, dt: float, load_side: bool) -> TrueAxis:
    """A random axis."""
    motor = float(random.uniform(30, 90))
    load = motor * float(random.uniform(0.3, 1.0))
    third = load * float(random.uniform(0.3, 0.6)) if random.uniform() < 0.35 else 0.0
    hertz, damping = float(random.uniform(45, 90)), float(random.uniform(0.02, 0.06))
    reduced = motor * (load + third) / (motor + load + third)
    first = (2 * np.pi * hertz) ** 2 * reduced
    second = (2 * np.pi * 2.2 * hertz) ** 2 * third
    dampers = (
        2 * damping * float(np.sqrt(first * reduced)),
        2 * damping * float(np.sqrt(second * third)),
    )
    dry = float(random.uniform(8, 40))
    coulomb = (dry, dry * float(random.uniform(0.4, 1.0)), 0.0)
    static = float(random.uniform(1.0, 1.5))
    force = float(random.uniform(25, 60))
    viscous = float(random.uniform(60, 300))
    delay = float(random.uniform(0.3, 2.0)) * 1e-3
    current = float(random.uniform(0.2e-3, 0.6e-3))
    total = motor + load + third
    largest = float(random.uniform(2.0, 4.0)) * total * ACCELERATION / force
    late = delay + current + INNER if takes == "position" else delay + current + 2 * dt
    speed = 0.2 / late if takes == "force" else 0.25 / (current + INNER)
    slow = damping if load_side and takes == "force" else 0.5
    speed = min(speed, slow * 2 * np.pi * hertz)
    return TrueAxis(
        takes=takes,
        masses=(motor, load, third),
        stiffness=(float(first), float(second)),
        damping=dampers,
        gap=float(random.choice([0.0, 2e-6, 8e-6, 20e-6])),
        coulomb=coulomb,
        static=(static * coulomb[0], static * coulomb[1], 0.0),
        viscous=(viscous, 0.2 * viscous, 0.0),
        stribeck=float(random.uniform(1e-3, 1e-2)),
        cogging=float(random.uniform(0, 4)),
        pitch=float(random.uniform(8e-3, 20e-3)),
        force=force,
        current=current,
        largest=largest,
        delay=delay,
        inner=(speed / 4, speed * total / force),
        load_side=load_side,
        count=float(random.choice([0.1e-6, 0.5e-6, 1e-6])),
    )


def machine(seed: int) -> tuple[str, float, list[TrueAxis]]:
    """Kind, sample period and axes of a hidden machine; the first two are known ones."""
    random = np.random.default_rng([seed, 57])
    takes = ("force", "position")[seed % 2]
    dt = PERIODS[(seed // 2) % 4 == 3]
    load_side = bool(random.uniform() < 0.4)
    axes = [hidden_axis(random, takes, dt, load_side) for _ in range(2)]
    if seed == 0:  # 55 Hz of damping 0.02, motor side, 8 um, 1.4 ms
        axes = [known_force(axes[0])] * 2
        dt, load_side = 1e-3, False
    if seed == 1:  # a drive of 18 ms, 1.5 ms late, 55 Hz of damping 0.062
        axes = [known_position(axes[0])] * 2
        dt, load_side = 1e-3, True
    where = "load" if load_side else "motor"
    masses = max(one.last for one in axes) + 1
    gap = max(one.gap for one in axes)
    kind = f"{takes}, {masses} masses, {where} encoder, {1e6 * gap:.2g} um, {1e-3 / dt:g} kHz"
    return kind, dt, axes


def known_force(one: TrueAxis) -> TrueAxis:
    """A motor of 60 kg and a load of 30 kg on a spring of 55 Hz and damping 0.02."""
    reduced, w = 60 * 30 / 90, 2 * np.pi * 55
    return replace(
        one,
        takes="force",
        masses=(60.0, 30.0, 0.0),
        stiffness=(w**2 * reduced, 0.0),
        damping=(2 * 0.02 * w * reduced, 0.0),
        gap=8e-6,
        coulomb=(40.0, 20.0, 0.0),
        static=(40.0, 20.0, 0.0),
        viscous=(150.0, 0.0, 0.0),
        cogging=0.0,
        force=35.0,
        current=STEP_LAG,
        largest=25.0,
        delay=1.4e-3,
        inner=(8.0, 90.0),
        load_side=False,
        count=1e-6,
    )


def known_position(one: TrueAxis) -> TrueAxis:
    """A drive that takes positions: 18 ms, and 55 Hz of damping 0.062 at the tool."""
    reduced, w = 60 * 30 / 90, 2 * np.pi * 55
    return replace(
        known_force(one),
        takes="position",
        damping=(2 * 0.062 * w * reduced, 0.0),
        gap=0.0,
        delay=1.5e-3,
        inner=(1 / 18e-3, 220 * 90 / 35.0),
        load_side=True,
        count=1e-6,
    )


def recorded(axes: list[TrueAxis], dt: float, seed: int) -> MachineRecord:
    """Record of what `--excite` writes; a drive that takes a force is in a cascade of its user."""
    limits = Excited(("X", "Y"), dt, *(np.full(2, one) for one in (TRAVEL, SPEED, ACCELERATION)))
    asked = program(limits)
    random = np.random.default_rng([seed, 58])
    found = stepped(axes, dt, recording_law(axes, asked, dt), len(asked))
    count = np.array([one.count for one in axes])
    noise = NOISE * count * random.standard_normal(found.position.shape)
    position = count * np.round((found.position + noise) / count)
    return MachineRecord(dt, limits.axes, found.command, position)


def recording_law(axes: list[TrueAxis], asked: Float[np.ndarray, "T m"], dt: float) -> Law:
    """The position itself, or a cascade with feedforward of the speed."""
    force = axes[0].takes == "force"
    speeds = np.gradient(asked, dt, axis=0)
    gains = np.array([one.inner for one in axes])
    k, before = -1, asked[0].copy()

    def law(y: np.ndarray) -> np.ndarray:
        nonlocal k, before
        k += 1
        if not force:
            return asked[k]
        speed, before = (y - before) / dt, y
        return gains[:, 1] * (gains[:, 0] * (asked[k] - y) + speeds[k] - speed)

    return law


def tuned_law(controller: Controller, reference: Reference) -> Law:
    """The controller along a reference, which rests where that ends."""
    plan = jax.device_get(prepared(controller, reference))
    memory, step = controller.initial_memory(reference), jax.jit(lambda c, *a: c.step(*a))
    rows, k = reference.steps, -1

    def law(y: np.ndarray) -> np.ndarray:
        nonlocal k, memory
        k += 1
        now = jax.tree.map(lambda leaf: leaf[min(k, rows - 1)], plan)
        memory, control = step(controller, memory, now, jnp.asarray(y))
        return np.asarray(control)

    return law


def measured(flags: Bench, tell: Callable[[str], None]) -> list[Way]:
    """Machines of two axes of one kind, from their records to their contour errors.

    Raises:
        ValueError: the file to keep them is none of this benchmark.
    """
    seeds = range(flags.first_seed, flags.first_seed + flags.seeds)

    def one(seed: int) -> list[Way]:
        with tempfile.TemporaryDirectory() as place:
            way = way_of(seed, Path(place))
        tell(f"{seed} {way.kind}: {way.verdict}: {way.reasons or way.fails or 'holds'}")
        jax.clear_caches()  # every machine has programs of its own: they would fill the memory
        return [way]

    return kept(flags.keep, Way, seeds, one)


def way_of(seed: int, place: Path) -> Way:
    """Record, model, controller and run of one machine; files are kept at a place."""
    kind, dt, axes = machine(seed)
    try:
        found = identify_machine(recorded(axes, dt, seed), MOST_POLES, MOST_DELAY)
        fields = machine_fields(found, f"hidden-{seed}", "A" if axes[0].takes == "force" else "m")
        limits = {"speed": [SPEED] * 2, "acceleration": [ACCELERATION] * 2}
        fields["limits"] |= limits
        if axes[0].takes == "force":  # the current of a drive is known
            fields["limits"]["control"] = [one.largest for one in axes]
        (place / "machine.json").write_text(json.dumps(fields))
        flags = Tune(plant=str(place / "machine.json"), out=place / "tuned", json=True)
        told, folder = tune.run(flags, console_of(quiet=True))
    except (ValueError, RuntimeError) as error:
        return Way(seed, kind, "refused", str(error))
    verdict = told.verdict
    reasons = " | ".join(one.text for one in verdict.messages if one.level != "warning")
    printed = 1e6 * max(one.metrics["tuned"].worst.rms_contour_error for one in told.contours)
    way = Way(seed, kind, verdict.heading, reasons, shown=found.shown_to, printed_um=printed)
    if not verdict.usable:
        return way
    run, weights = stored_tuning(folder)
    return _on_the_machine(way, run, run.controller(weights), told, axes)


def _on_the_machine(
    way: Way, loop: TuningRun, controller: Controller, told: TunedResult, axes: list[TrueAxis]
) -> Way:
    """The tuned loop on the machine itself."""
    dt, jobs = loop.machine.model.dt, loop.scenarios.jobs
    numbers, rings = [], 0.0
    longest = max(job.samples for job in jobs) + round(REST / dt)  # of all: one compiled program
    for job, printed in zip(jobs, told.contours, strict=True):
        whole = with_held_end(job, longest - job.samples)
        reference = whole.reference(dt, controller.preview)
        found = _followed(axes, controller, reference, dt)
        asked = np.asarray(reference.position)[: reference.steps]
        before = stepped(axes, dt, recording_law(axes, asked, dt), len(asked), asked[0])
        own = np.arange(len(reference.mask)) < job.steps  # the rest is held longer than printed
        scored = replace(reference, mask=reference.mask & own)
        encoder, tool, recorded = (
            score_signals(part[: len(asked)], found.command[: len(asked)], scored)
            for part in (found.position, found.tool, before.tool)
        )
        worst = printed.metrics["tuned"].worst
        ratios = [
            float(encoder.rms_contour_error) / worst.rms_contour_error,
            float(encoder.peak_contour_error) / worst.peak_contour_error,
        ]
        numbers.append([*ratios, *(1e6 * float(one.rms_contour_error) for one in (recorded, tool))])
        rest = found.position[-round(REST / 2 / dt) :]
        counts = np.ptp(rest, axis=0) / np.array([one.count for one in axes]) / (2 * RINGS)
        rings = max(rings, float(np.nan_to_num(counts, nan=np.inf).max()))
    still = with_held_end(jobs[0], longest - jobs[0].samples).reference(dt, controller.preview)
    linear = [replace(one.linear, count=0.0) for one in axes]
    calm, knocked = (_followed(linear, controller, still, dt, by) for by in (0.0, KNOCK))
    left = knocked.position - calm.position
    tenth = len(left) // 10
    # held integrals leave an offset: what has to end is the motion
    before, last = np.ptp(left[-2 * tenth : -tenth], axis=0), np.ptp(left[-tenth:], axis=0)
    stable = bool(np.all((last < GROWN * before + 1e-9) & (np.abs(left[-tenth:]) < KNOCK)))
    names = "rms", "peak", "recorded_um", "tuned_um"
    worst = dict(zip(names, np.max(numbers, axis=0).tolist(), strict=True))
    sensitivity = _sensitivity(loop, controller, axes)
    return replace(way, stable=stable, rings=rings, sensitivity=sensitivity, **worst)


def _followed(
    axes: list[TrueAxis], controller: Controller, reference: Reference, dt: float, off: float = 0.0
) -> TrueRun:
    start = np.asarray(reference.position[0]) + off
    return stepped(axes, dt, tuned_law(controller, reference), reference.steps, start)


def _sensitivity(loop: TuningRun, controller: Controller, axes: list[TrueAxis]) -> float:
    """Ms on the true response, an axis at a time."""
    model = loop.machine.model
    w = np.union1d(GRID, np.pi * np.geomspace(0.02, 0.5, 400))
    hertz, exact = w / (2 * np.pi * model.dt), np.zeros(len(w))
    lines = tuple(
        Lines(w, response(axis, model.dt, w) / model_response(model, k, hertz) - 1, exact)
        for k, axis in enumerate(axes)
    )
    still = ResponseUncertainty(np.ones(1), np.zeros((1, len(axes))), lines)
    linear = loop.machine.linear
    assert linear is not None  # it comes from a record
    true = replace(linear, uncertainty=linear.uncertainty._replace(response=still))
    peak = measured_peak(controller, true, loop.scenarios, loop.design.fed)
    return float("inf") if peak is None else peak


COLUMNS: dict[str, Column] = {
    "machine": lambda one: f"{one.seed}: {one.kind}",
    "before, um": "recorded_um:,.0f",
    "tuned, um": "tuned_um:,.0f",
    "printed, um": "printed_um:,.0f",
    "RMS over it": "rms:.2f",
    "peak over it": "peak:.2f",
    "Ms": "sensitivity:.3g",
    "verdict": lambda one: one.fails or "holds" if one.verdict == USE else "refused",
}


def stored() -> list[Way]:
    """Machines of the site."""
    lines = Path(__file__).with_name("whole_way.jsonl").read_text().splitlines()
    return [Way(**row) for line in lines for row in json.loads(line)[1]]


def tables(result: list[Way]) -> Iterator[Table | str]:
    """How many end in USE, and how many of these fail."""
    used = [one for one in result if one.verdict == USE]
    failed = [one for one in used if one.fails]
    yield Table("Hidden machines", result, COLUMNS)
    yield f"{len(used)} of {len(result)} end in USE, {len(failed)} of these fail"
