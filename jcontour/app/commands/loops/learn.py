"""`jcontour learn`: laps of a part, each with what was learned from the last."""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from jcontour.app.catalogue.choices import design_for, job_named, machine_named, seeing_all
from jcontour.app.designs.design import plain_weights
from jcontour.app.files.bent_reference import SAMPLES, save_samples
from jcontour.app.files.results.learned_result import LearnedMachine, LearnedResult, StoredLap
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.flags.loops import Learn
from jcontour.app.jobs.job import Pace
from jcontour.app.reports import tables
from jcontour.app.reports.figures.shared.png import save_figure
from jcontour.app.reports.figures.tuning.learning import learning
from jcontour.app.reports.learning_tables import loading, show_learned
from jcontour.app.runs.forecast import Steps, outline
from jcontour.app.runs.lifecycle import created, finished
from jcontour.app.runs.loops.learned_machines import setting
from jcontour.app.runs.loops.learned_reference import shifted, stored_lap
from jcontour.app.runs.loops.learning import LapScores, Learner, Prepared, prepared_law
from jcontour.app.runs.tuning.results import machine_summary
from jcontour.devices import on_cpu

OF_OTHER_LAW = {"norm-optimal": ("gain", "lead"), "p-type": ("effort",)}


@on_cpu()  # the laws take both modes of the laps
def command(flags: Learn) -> int:
    """The whole command: learn, print, exit code."""
    found, folder = run(flags)
    return finished(folder, found, flags, show_learned, loading(found, SAMPLES), found.verdict)


def run(flags: Learn) -> tuple[LearnedResult, Path]:
    """Run all laps and store them; the result and the run folder.

    Raises:
        ValueError: bad input; nothing has been written then.
    """
    _check(flags)
    machine = machine_named(flags.plant)
    job = job_named(flags.contour or machine.usual.simulated, Pace.of(flags, machine))
    flags = seeing_all(flags, job)
    design = design_for(machine, flags)
    one = setting(design, job)
    console = tables.console_of(stderr=True, quiet=flags.json)
    with console.status("finding the law") as status:
        doing = f"finding the law, then {flags.laps} laps"
        tables.say(console, outline(job, machine.model.dt, len(machine.family_names), doing))
        began = time.perf_counter()
        prepared = prepared_law(one, flags)
        tables.say(console, _found(time.perf_counter() - began, job.steps))
        folder = created(flags, "learn")
        learner = Learner(one, prepared.law, flags.seed)
        steps = Steps(status, "lap", flags.laps)

        def tell(lap: int, scores: LapScores) -> None:
            _tell(console, lap, flags.laps, scores)
            steps.done(lap)

        machines = learner.run(flags.laps, tell)
    assert learner.best is not None  # there is a lap at least
    position = shifted(one.reference, learner.best)
    limits, axes = machine.limits, machine.axes
    stored = stored_lap(position, machine.model.dt, learner.best, limits, axes)
    verdict = verdict_on(machines, stored)
    if stored is not None and verdict.usable:
        save_samples(position, machine.model.dt, machine.axes, folder)
    found = LearnedResult(
        machine=machine_summary(machine),
        controller=design.name,
        weights=plain_weights(design.start),
        error=machine.error,
        contour=job.name,
        feed_law=job.feed_law,
        samples=job.steps,
        law=flags.law,
        numbers=prepared.numbers,
        laps=flags.laps,
        **_known(prepared, machine.family_names, machine.model.dt),
        noise_um=1e6 * learner.noise(),
        machines=machines,
        verdict=verdict,
        stored=stored,
    )
    save_figure(learning(found), folder / "learning.png")
    write_result(folder, found)
    return found, folder


def verdict_on(machines: Sequence[LearnedMachine], stored: StoredLap | None) -> Verdict:
    """Verdict on the learned reference: machines that diverge, limits that it asks too much of."""
    limits = [] if stored is None else stored.limits
    against = [
        f"{one.name} diverges at lap {one.diverged}" for one in machines if one.diverged is not None
    ]
    helps = ["a larger --smoothing, or a slower feed, asks less of the machine"]
    passed = "Nothing is learned." if stored is None else "USE THIS REFERENCE"
    return Verdict.of(limits, against, (), helps, passed)


def _check(flags: Learn) -> None:
    for name, least in {"laps": 1, "smoothing": 0, "lead": 0}.items():
        value = getattr(flags, name)
        if value is not None and value < least:
            raise ValueError(f"{name}: needs to be at least {least}, received {value}")
    if not flags.effort > 0:
        raise ValueError(f"effort: needs to be above zero, received {flags.effort}")
    if not 0 <= flags.gain < np.inf:
        raise ValueError(f"gain: needs to be finite and at least zero, received {flags.gain}")
    for name in OF_OTHER_LAW[flags.law]:
        if getattr(flags, name) != getattr(Learn(), name):
            raise ValueError(f"{name}: the law {flags.law} has none; leave it out")


def _known(prepared: Prepared, names: list[str], dt: float) -> dict:
    """What was known before the first lap."""
    found = prepared.convergence
    hertz = found.frequency / (2 * np.pi * dt)
    return {
        "ratio": found.estimate,
        "ratio_member": names[found.member],
        "ratio_hz": hertz,
        "proven": found.invariant,
    }


def _found(seconds: float, samples: int) -> str:
    """A line between the law and the first lap, which takes longer than the others."""
    return (
        f"The law took {tables.digits(seconds)} s, by linear models of {samples:,} samples. The "
        "first lap compiles: up to half a minute of processor time."
    )


def _tell(console: Console, lap: int, laps: int, scores) -> None:
    """One line on stderr for every lap."""
    if console.is_terminal:
        worst = 1e6 * float(np.nanmax(scores.tool[2:]))
        tables.say(console, f"lap {lap} of {laps}: worst of the family {worst:.4g} um")
