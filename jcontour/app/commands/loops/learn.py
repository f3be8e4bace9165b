"""`jcontour learn`: laps of a part, each with what was learned from the last."""

from collections.abc import Sequence

import numpy as np
from rich.console import Console

from jcontour._devices import on_cpu
from jcontour.app.catalogue.choices import design_for, job_named, machine_named, seeing_all
from jcontour.app.designs.design import plain_weights
from jcontour.app.files.bent_reference import SAMPLES, save_samples
from jcontour.app.files.results.loop_results import LearnedMachine, LearnedResult, StoredLap
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.verdict import Verdict, reason
from jcontour.app.flags.loops import Learn
from jcontour.app.jobs.job import Pace
from jcontour.app.plain_numbers import feed_words
from jcontour.app.reports import tables
from jcontour.app.reports.figures.axes import save_figure
from jcontour.app.reports.figures.loops import learning
from jcontour.app.reports.progress import counted
from jcontour.app.reports.screen import Entry
from jcontour.app.reports.tables import digits, say
from jcontour.app.runs.contour_summary import loop_summary, run_outline
from jcontour.app.runs.lifecycle import created, finished
from jcontour.app.runs.loops.learning import (
    Learner,
    prepared_law,
    setting,
    shifted,
    stored_lap,
)


@on_cpu()  # the laws take both modes of the laps
def command(flags: Learn) -> int:
    """The whole command: learn, print, exit code."""
    for name, least in {"laps": 1, "smoothing": 0}.items():
        value = getattr(flags, name)
        if value is not None and value < least:
            raise ValueError(f"{name}: needs to be at least {least}, received {value}")
    if not flags.effort > 0:
        raise ValueError(f"effort: needs to be above zero, received {flags.effort}")
    machine = machine_named(flags.plant)
    job = job_named(flags.contour or machine.usual.simulated, Pace.of(flags, machine))
    flags = seeing_all(flags, job)
    design = design_for(machine, flags)
    one = setting(design, job)
    console = tables.console_of(stderr=True, quiet=flags.json)
    doing = f"finding the law, then {flags.laps} laps"
    tables.say(console, run_outline(job, machine.model.dt, len(machine.family_names), doing))
    with console.status("finding the law"):
        prepared = prepared_law(one, flags)
    folder = created(flags, "learn")
    learner = Learner(one, prepared.law, flags.seed)
    with counted(console, flags.laps, "laps") as done:
        machines = learner.run(flags.laps, done)
    assert learner.best is not None  # there is a lap at least
    position = shifted(one.reference, learner.best)
    limits, axes = machine.limits, machine.axes
    stored = stored_lap(position, machine.model.dt, learner.best, limits, axes)
    verdict = verdict_on(machines, stored)
    if stored is not None and verdict.usable:
        save_samples(position, machine.model.dt, machine.axes, folder)
    known = prepared.convergence
    result = LearnedResult(
        **loop_summary(machine, design.name),
        weights=plain_weights(design.start),
        contour=job.name,
        feed_law=job.feed_law,
        samples=job.steps,
        numbers=prepared.numbers,
        laps=flags.laps,
        ratio=known.estimate,
        ratio_member=machine.family_names[known.member],
        ratio_hz=known.frequency / (2 * np.pi * machine.model.dt),
        proven=known.invariant,
        noise_um=1e6 * learner.noise(),
        machines=machines,
        verdict=verdict,
        stored=stored,
    )
    save_figure(learning(result), folder / "learning.png")
    write_result(folder, result)
    family = [one for one in result.machines[1:] if one.best_um is not None]
    worst = sorted(family, key=lambda one: -(one.best_um or 0.0))[:1]
    shown = [result.machines[0], *worst]
    answer = [Entry("Laps", f"{one.name}: {_outcome(one)}") for one in shown]
    answer += [Entry("To load", line) for line in loading(result, SAMPLES)]
    if result.ratio >= 1:
        ratio = f"ratio from lap to lap {result.ratio:.3g}, not below one"
        answer.append(Entry("Warning", f"it is not sure that the laps converge: {ratio}"))
    return finished(folder, result, flags, show_learned, answer, result.verdict)


def verdict_on(machines: Sequence[LearnedMachine], stored: StoredLap | None) -> Verdict:
    """Verdict on the learned reference: machines that diverge, limits that it asks too much of."""
    limits = [] if stored is None else stored.limits
    against = [
        reason(f"{one.name} diverges at lap {one.diverged}")
        for one in machines
        if one.diverged is not None
    ]
    helps = ["a larger --smoothing, or a slower feed, asks less of the machine"]
    passed = "Nothing is learned." if stored is None else "USE THIS REFERENCE"
    return Verdict.of(limits, against, helps, passed)


def show_learned(result: LearnedResult, console: Console) -> None:
    """What was known before, and when it stops paying; learning.png has the errors lap by lap."""
    say(
        console,
        *before(result),
        "",
        f"Encoder noise alone makes {digits(result.noise_um)} um, without learning.",
        *(f"{one.name}: {_outcome(one)}" for one in result.machines),
    )


def before(result: LearnedResult) -> list[str]:
    """The law, and what is said before the first lap."""
    numbers = ", ".join(f"{name} {value:g}" for name, value in result.numbers.items())
    place = f"{result.ratio_member}, {result.ratio_hz:.4g} Hz"
    if result.assured:
        words = (
            "By its linear models, without dry friction, the laps converge on the whole family: "
            "away from the ends of the lap each comes closer by the factor "
            f"{result.ratio:.3g} at least, for every correction ({place})."
        )
    elif result.ratio < 1:
        words = (
            "By its linear models, without dry friction, each lap comes closer by the factor "
            f"{result.ratio:.3g} ({place}). This is an estimate at three places of the lap and no "
            "bound: the loop or the law changes along it."
        )
    else:
        words = (
            f"WARNING: it is not sure that the laps converge: ratio from lap to lap "
            f"{result.ratio:.3g}, not below one ({place})."
        )
    return [f"Law: norm-optimal, {numbers}. {words}"]


def loading(result: LearnedResult, file: str) -> list[str]:
    """What a control loads, what for, and what was not looked at."""
    one = result.stored
    if one is None:
        return ["nothing: no lap of the linear model is better than the first"]
    if not result.verdict.usable:
        return [f"nothing: {file} is not written, as lap {one.lap} of the linear model had it"]
    weights = []
    for name, value in result.weights.items():
        each = value if isinstance(value, list) else [value]
        numbers = ("none" if number is None else f"{number:.6g}" for number in each)
        weights.append(f"{name} {' '.join(numbers)}")
    return [
        f"{file}: the reference at every sample as lap {one.lap} of the linear model had it "
        f"({digits(one.error_um)} um), shifted by up to {digits(one.largest_um)} um; it begins "
        f"{digits(one.first_um)} um beside the part, a step for the tool that stands there, and "
        f"then asks an axis for up to {feed_words(one.speed)} and {digits(one.acceleration)} m/s^2",
        f"it is for {result.controller} with {', '.join(weights)}, and for no other one; on the "
        "machine go on from it lap by lap",
    ]


def _outcome(one: LearnedMachine) -> str:
    if one.diverged is not None:
        return f"diverges, stopped at lap {one.diverged}"
    first, best = one.tool_um[0], one.best_um
    if best is None:
        return "no lap has a finite error at the tool"
    if one.pays_until == 1:
        words = f"learning does not pay: {digits(first)} um in the first lap"
        if one.measured_um[-1] < 0.5 * one.measured_um[0]:
            words += "; the measured error falls, that of the tool is not measured"
        return words
    pays = (
        "in the last lap it still pays"
        if one.pays_until == len(one.tool_um)
        else (f"after lap {one.pays_until} it no longer pays")
    )
    return f"{digits(first)} to {digits(best)} um; {pays}"
