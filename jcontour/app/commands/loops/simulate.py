"""`jcontour simulate`: one controller on one contour, on every plant of the machine's family."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.status import Status

from jcontour.app.catalogue.choices import design_for, job_named, machine_named, seeing_all
from jcontour.app.catalogue.entries import CONSTRAINED
from jcontour.app.designs.design import Design, plain_weights
from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.results.run_metrics import RunMetrics
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.verdict import Verdict, kept_words, reason, warning
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.job import Job, Pace
from jcontour.app.jobs.pace import check_memory
from jcontour.app.jobs.replays import Replay, Scenarios, replay
from jcontour.app.machines.machine import Machine
from jcontour.app.reports import tables
from jcontour.app.reports.figures.axes import save_figure
from jcontour.app.reports.figures.contours import figures_of
from jcontour.app.reports.rollouts import save_rollouts
from jcontour.app.reports.run_tables import show_simulated, simulated_answer
from jcontour.app.reports.screen import Entry, next_step
from jcontour.app.runs.checks.machine_limits import machine_limits, peak_controls
from jcontour.app.runs.checks.run_checks import (
    NAN,
    lost_numbers,
    machine_warnings,
    motions_not_followed,
)
from jcontour.app.runs.contour_summary import (
    Simulated,
    contour_runs,
    loop_summary,
    motion_summary,
    peak_place,
    read_of,
)
from jcontour.app.runs.lifecycle import created, finished, tuning_words

SATURATED = 0.1  # share of the samples: starts and corners saturate for less


def command(flags: Simulate) -> int:
    """The whole command: simulate, print, exit code."""
    with tables.console_of(stderr=True, quiet=flags.json).status("planning the motion") as status:
        result, folder = run(flags, status)
    nominal = next(iter(result.plants.values()))
    undefined = any(NAN in one for one in result.verdict.warnings)
    saturated = max((one.saturated for one in result.verdict.limits), default=0.0)
    then = next_steps(flags, nominal.diverged, undefined, saturated)
    if flags.controller in CONSTRAINED and not result.verdict.usable:
        then = []  # the verdict says it
    answer = [*simulated_answer(result), *then]
    return finished(folder, result, flags, show_simulated, answer, result.verdict)


def run(flags: Simulate, status: Status) -> tuple[SimulatedResult, Path]:
    """Simulate and store; the result and the run folder.

    The status shows what is being done, and how long it will take.
    """
    machine = machine_named(flags.plant)
    # the part comes before the design: a fault in line 1 of a program stops at once
    job = job_named(flags.contour or machine.usual.simulated, Pace.of(flags, machine))
    figures = {}
    if flags.controller in CONSTRAINED:
        status.update("solving a quadratic program at every sample")
        from jcontour.app.runs.loops.traversing import traversed  # the solvers take a while

        made = traversed(flags, machine, job)
    else:
        flags = seeing_all(flags, job)
        design = design_for(machine, flags)
        check_memory(job.name, job.samples, len(machine.family_names))
        status.update(f"running {job.samples:,} samples")
        if isinstance(job, Job) and job.planned:
            from jcontour.app.reports.figures.motion import motion_figure

            figures["motion"] = motion_figure(job.planned, machine.axes, job.rapid)
        scenarios = Scenarios.of([job], [False], machine, design.fed, design.preview)
        made = simulated(design, scenarios, replay(design.complete(design.start), scenarios))
    result, named = made.result, {made.result.controller: made.replay}
    status.update("writing and drawing")
    folder = created(flags, "simulate")
    title = f"jcontour simulate: {result.controller} on {result.contour}"
    figures |= figures_of(contour_runs(named, made.scenarios, 0, machine))
    for name, figure in figures.items():
        save_figure(figure, folder / f"{name}.png")
    save_rollouts(flags.rollouts, named, made.scenarios, machine, title, folder)
    write_result(folder, result)
    return result, folder


def simulated(design: Design, scenarios: Scenarios, replayed: Replay) -> Simulated:
    """Runs of one contour and their result."""
    machine, job = design.machine, scenarios.jobs[0]
    metrics = [
        RunMetrics.of(replayed.metrics, lambda values, k=k: values[0, k])
        for k in range(len(scenarios.plants))
    ]
    result = SimulatedResult(
        **loop_summary(machine, design.name),
        weights=plain_weights(design.start),
        contour=job.name,
        feed_law=job.feed_law,
        samples=job.samples,
        **design.settings(),
        plants=dict(zip(scenarios.plants, metrics, strict=True)),
        read=read_of(scenarios.jobs[0], scenarios.references.dt),
        peak=peak_place(scenarios, replayed, 0, machine.error),
        peak_controls=peak_controls(replayed, scenarios),
        motion=motion_summary(job.planned) if isinstance(job, Job) and job.planned else None,
        verdict=_verdict(scenarios, replayed, machine),
        sample_period=float(machine.model.dt),
    )
    return Simulated(result, scenarios, replayed)


def _verdict(scenarios: Scenarios, replayed: Replay, machine: Machine) -> Verdict:
    """Limits of the machine, plants that diverge, and motions that are not followed."""
    diverged = np.asarray(replayed.metrics.diverged)[0]
    lost = [name for name, gone in zip(scenarios.plants, diverged, strict=True) if gone]
    limits = machine_limits(replayed, scenarios, machine)
    many = f"{len(lost)} of {len(scenarios.plants)} plants"
    return Verdict.of(
        limits,
        [
            *([reason(f"it diverges on {many}: {', '.join(lost)}")] if lost else []),
            *map(reason, motions_not_followed(replayed, scenarios)),
            *map(warning, lost_numbers(replayed, scenarios)),
            *machine_warnings(replayed, scenarios, machine),
        ],
        passed=kept_words(limits),
    )


def next_steps(
    flags: Simulate, lost: bool = False, undefined: bool = False, saturated: float = 0.0
) -> list[Entry]:
    """What to do after a simulation, or after one that is lost on the nominal plant.

    Args:
        flags: of the simulation.
        lost: whether the nominal plant diverges.
        undefined: whether it meets NaN: no weights help then.
        saturated: largest share of the samples at which a control saturates; weights that were
            given are no start then.
    """
    if lost and undefined:
        words = "mend what is NaN (not a number), see the warning; other weights do not help"
        return [next_step(words)]
    if lost:
        words = (
            "other weights, or another controller, with which the nominal plant does not diverge; "
            "tuning begins from there"
        )
        return [next_step(words)]
    part = [] if flags.contour is None else [flags.contour]
    if flags.controller in CONSTRAINED:
        return [next_step("other --weights, --preview or --feed-mm-per-min: none is tuned")]
    if saturated > SATURATED:
        flags = replace(flags, weights=(), alpha=None, beta=None, rho=None)
    return [next_step(f"jcontour tune{tuning_words(part, vars(flags))}")]
