"""`jcontour precompensate`: a bent reference that any control can run, with its error."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

from jcontour.app.catalogue.choices import seeing_all
from jcontour.app.files.bent_reference import (
    PROGRAM,
    SAMPLES,
    Moves,
    save_program,
    save_samples,
)
from jcontour.app.files.results.loop_results import BentResult
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.verdict import Verdict, exceeded, reason, warning
from jcontour.app.flags.loops import Precompensate
from jcontour.app.jobs.job import Job
from jcontour.app.jobs.sections import sections
from jcontour.app.plain_numbers import feed_words
from jcontour.app.reports import tables
from jcontour.app.reports.figures.axes import save_figure
from jcontour.app.reports.figures.loops import bent_figure
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.contour_summary import loop_summary
from jcontour.app.runs.lifecycle import created, finished
from jcontour.app.runs.loops.bending import STILL, Bent, bent, moves_along
from jcontour.app.runs.stored_loops import StoredLoop, loop_named

SAME = 5e-3  # of an error: less of a change has no digit of its own
BOUNDS = ("speed", "acceleration", "control")
NOTHING = 1e-9  # [m] of an error: a ratio to less says nothing


def command(flags: Precompensate) -> int:
    """The whole command; exit code."""
    if not flags.roughness > 0:
        raise ValueError(f"roughness: needs to be above zero, received {flags.roughness}")
    loop = loop_named(flags, flags.part)
    bend = bent(loop, flags.roughness, tables.console_of(stderr=True, quiet=flags.json))
    machine, job = loop.machine, bend.job
    flat = len(machine.axes) > 1
    source = Path(loop.parts[0]).name
    moves = moves_along(bend.position, machine.model.dt, sections(job), source) if flat else []
    result = _result(loop, bend, moves)
    verdict = verdict_on(result)
    result = replace(result, verdict=verdict)
    folder = created(seeing_all(flags, job), "precompensate")
    if verdict.usable:
        # Which samples are cut, where not all are
        counted = job.counted if isinstance(job, Job) and job.rapid.any() else None
        save_samples(bend.position, machine.model.dt, machine.axes, folder, counted)
    if verdict.usable and flat:
        save_program(
            moves,
            machine.axes,
            folder,
            [
                f"bent by jcontour from {source}",
                f"for {result.machine.name} with the controller {result.controller}, "
                "and for no other one",
                *result.weights,
                f"largest bend {tables.digits(1e6 * result.largest)} um",
            ],
        )
    title = f"{job.name} on {machine.name}, {loop.name}"
    errors = [bend.errors(runs, machine.error) for runs in (bend.before, bend.after)]
    about = title, machine.error, machine.axes, bend.reference, bend.correction
    save_figure(bent_figure(*about, *errors), folder / "bent.png")
    write_result(folder, result)
    answer = [Entry("Error", gain_words(result))]
    answer += [Entry("Note", words) for words in (*ending(result), *result.warnings)]
    answer += [Entry("To load", line) for line in _loading(result)] if verdict.usable else []
    return finished(folder, result, flags, show, answer, verdict)


def _result(loop: StoredLoop, bend: Bent, moves: Sequence[Moves]) -> BentResult:
    machine, job = loop.machine, bend.job
    return BentResult(
        **loop_summary(machine, loop.name),
        contour=job.name,
        samples=job.steps,
        roughness=bend.roughness,
        largest=float(np.linalg.norm(bend.correction, axis=1).max()),
        chord=max((one.chord for one in moves), default=None),
        moves=sum(one.going for one in moves),
        before=bend.metrics(bend.before),
        after=bend.metrics(bend.after),
        limits=bend.limits,
        limits_before=bend.limits_before,
        asked=bend.asked,
        halts=sum(bool(one.asked) for one in moves),
        ramps=0 if job.program is None else len(job.program.ramps),
        unlimited=tuple(name for name in BOUNDS if getattr(machine.limits, name) is None),
        weights=loop.weights,
        warnings=() if job.program is None else job.program.warnings,
        held=None if bend.held is None else bend.held * machine.model.dt,
        rests=bend.rests,
        changing=max((one.acceleration for one in moves if not one.rapid), default=0.0),
    )


def show(result: BentResult, console: Console) -> None:
    """The table, and the gains that the bend is for; the screen has the rest."""
    title = f"{result.contour} on {result.machine.name}, {result.controller}, "
    title += f"machine with {result.machine.nonsmooth_effects}"
    before, after, error = result.before, result.after, result.error
    columns: dict[str, Callable[[str], str | float]] = {
        "plant": lambda plant: plant,
        "RMS um\nbefore": lambda plant: 1e6 * before[plant].rms(error),
        "RMS um\nafter": lambda plant: 1e6 * after[plant].rms(error),
        "peak um\nbefore": lambda plant: 1e6 * before[plant].peak(error),
        "peak um\nafter": lambda plant: 1e6 * after[plant].peak(error),
        "peak control\nbefore": lambda plant: before[plant].peak_control,
        "peak control\nafter": lambda plant: after[plant].peak_control,
    }
    console.print(tables.table_of(title, before, columns))
    if result.weights:
        tables.say(console, f"Bent for {result.controller} with these gains, and for no others:")
        tables.say(console, *(f"  {line}" for line in result.weights))
    tables.say(console, *result.warnings)


def ending(result: BentResult) -> list[str]:
    """How the run ends."""
    if result.held is None:
        return [
            "The run ends in motion: how the tool comes to rest behind it is not in these numbers."
        ]
    if not result.held and result.rests:
        return []
    size = f"{tables.digits(1e6 * STILL)} um"
    if not result.rests:
        return [
            f"WARNING: {tables.digits(result.held)} s after the end a tool still moves by more "
            f"than {size}: what it does later is not in these numbers."
        ]
    return [
        f"The last point is held for {tables.digits(result.held)} s, until every tool rests to "
        f"within {size}: it is scored like the part."
    ]


def gain_words(result: BentResult) -> str:
    """Errors with the bend against those without, and what the bend asks for."""
    return (
        f"RMS {result.error} error: nominal {_change(*result.nominal)}, "
        f"worst of the family {_change(*result.worst)}. "
        f"The reference moves by up to {tables.digits(1e6 * result.largest)} um; "
        f"it asks an axis for up to {feed_words(result.asked[0])} and "
        f"{tables.digits(result.asked[1])} m/s^2."
    )


def verdict_on(result: BentResult) -> Verdict:
    """Verdict on a bent reference: better for the worst machine than it is worse for the nominal.

    Every plant follows, and no limit is exceeded.
    """
    files = SAMPLES if result.chord is None else f"{SAMPLES} and {PROGRAM}"
    helps = "a larger --roughness asks less of the machine"
    if exceeded(result.limits_before):
        helps = (
            f"{result.controller} exceeds a limit of the machine without any bend: choose calmer "
            "gains, or tune it"
        )
    lost = any(run.diverged for run in result.after.values())
    messages = [reason("a plant of the family diverges")] if lost else []
    if not (result.worst_gain > 1 and result.worst_gain * result.nominal_gain > 1):
        less = "gains less than the nominal one loses"
        better = less if result.worst_gain > 1 else "is no better"
        messages.append(
            reason(
                f"the worst machine {better}. Either one shift cannot help it without harm to "
                "another of the family, or the controller already sees what the model knows"
            )
        )
    if result.unlimited:
        messages.append(
            warning(
                f"{result.machine.name} states no limit of {' or '.join(result.unlimited)}",
                "look at whether your drives give what is asked for above, or state their limits "
                "in a machine file",
            )
        )
    verdict = Verdict.of(result.limits, messages, [helps], passed="USE THIS REFERENCE")
    if verdict.usable:
        return verdict
    left_out = warning(f"not written for that reason: {files}")
    return replace(verdict, messages=[*verdict.messages, left_out])


def _change(before: float, after: float) -> str:
    """What becomes of an error [m]: a ratio, or both sizes where one is next to nothing."""
    if min(before, after) < NOTHING:
        return f"{tables.digits(1e6 * before)} -> {tables.digits(1e6 * after)} um"
    if abs(before - after) < SAME * after:
        return "the same"
    if before > after:
        return f"{before / after:.3g} times smaller"
    return f"{after / before:.3g} times LARGER"


def _loading(result: BentResult) -> list[str]:
    """Files for the control, and what is to be known of each."""
    rest = f", with {tables.digits(result.held)} s of rest at its end" if result.held else ""
    lines = [f"{SAMPLES}: the reference at every sample{rest}, for a control that streams it"]
    if result.chord is not None:
        away = tables.digits(1e6 * result.chord)
        lines.append(
            f"{PROGRAM}: {result.moves} straight moves within {away} um of it at the same "
            f"time, at exactly their feeds, which change by up to {tables.digits(result.changing)} "
            "m/s^2; a control whose look-ahead slows them down does not run it as meant"
        )
    axes = result.machine.axes
    if result.halts:
        places = "1 place" if result.halts == 1 else f"{result.halts} places"
        z = "Z moves, " if len(axes) == 2 else ""
        lines.append(
            f"{PROGRAM} moves {' and '.join(axes)} alone and stops (M0) at {places}: put the "
            f"{z}spindle and laser words of your program there"
        )
    if result.ramps:
        moves = "1 move" if result.ramps == 1 else f"{result.ramps} moves"
        lines.append(
            f"Z moves along with X and Y in {moves} of your program; {PROGRAM} leaves Z "
            "alone there, and cuts as deep as the tool stands"
        )
    return lines
