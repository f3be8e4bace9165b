"""`jcontour tune`: weights of a controller by gradient, with everything an engineer needs to trust them."""

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from rich.console import Console

from experiments.files import run_folder
from experiments.files.checkpoints import load_state, save_state
from experiments.files.netcdf import save_dataset
from experiments.jobs.replays import Replay
from experiments.options import Tune
from experiments.reports import figures, tables
from experiments.reports.progress import progress_of
from experiments.reports.rollouts import rollouts
from experiments.runs.lifecycle import finished, opened
from experiments.runs.tuning import PLENTY, TuningRun, tuning_run
from experiments.runs.tuning_results import confirmed, history_of, proved, summarise
from tuning.tune import Tuned, TuneState, advance, result


def run(flags: Tune, console: Console) -> tuple[dict[str, Any], Path]:
    """Tune, or go on tuning; the summary and the run folder.

    Raises:
        ValueError: bad input; nothing has been written then.
    """
    with opened(flags, "tune", tuning_run) as (folder, job):
        describe(job, console)
        return _tuned(job, folder, console), folder


def _tuned(job: TuningRun, folder: Path, console: Console) -> dict[str, Any]:
    began = time.perf_counter()
    with ThreadPoolExecutor(1) as beside:
        start = beside.submit(
            proved, job, job.start
        )  # compiles on the second core while the tuner descends
        tuned, state = _descended(job, folder, console)
        proofs = {"start": start.result(), "tuned": proved(job, tuned.weights)}
    summary = summarise(job, tuned, state, proofs) | {
        "confirmed": confirmed(job, tuned, proofs["tuned"].replay)
    }
    summary["seconds"] = time.perf_counter() - began
    store(job, summary, tuned, {name: proof.replay for name, proof in proofs.items()}, folder)
    return summary


def _descended(job: TuningRun, folder: Path, console: Console) -> tuple[Tuned, TuneState]:
    state = load_state(folder)
    with progress_of(console, job.settings, job.machine.error) as show:
        while not state.done:
            state = advance(job.problem, job.start, job.settings, state)
            save_state(folder, state)
            show(state)
    try:
        return result(job.problem, job.start, state), state
    except ValueError as error:
        raise RuntimeError(f"no result: {error}; the points tried are kept in {folder}") from None


def describe(job: TuningRun, console: Console) -> None:
    """Say what is tuned."""
    machine, flags, scenarios = job.machine, job.flags, job.scenarios
    limits = ", ".join(f"{name} <= {value:.6g}" for name, value in job.limits.items()) or "none"
    facts = machine.description() | {
        "Family": "; ".join(scenarios.plants)
        + (" (tuned on the nominal plant alone)" if flags.nominal_only else ""),
        "Training": "; ".join(
            f"{one.name} ({one.samples} samples, {one.feed_law})"
            for one in scenarios.jobs_seen(True)
        ),
        "Held out": "; ".join(
            f"{one.name} ({one.samples} samples)" for one in scenarios.jobs_seen(False)
        ),
        **job.design.description(),
        "Objective": f"{flags.objective} RMS {machine.error} error over training contours and "
        f"{'the plant' if flags.nominal_only else 'family'}; limits: {limits}",
    }
    lines = [f"{heading:<11} {fact}" for heading, fact in facts.items()]
    lines.append(
        f"Tuned without {machine.nonsmooth_effects} (they have no slope); the tables below are with them."
    )
    if job.training_samples > PLENTY:
        lines.append(f"{job.training_samples} training samples: this takes longer than a minute.")
    tables.say(console, *lines)


def store(
    job: TuningRun, summary: dict[str, Any], tuned: Tuned, replays: dict[str, Replay], folder: Path
) -> None:
    """Write everything but the settings and the state, which are there; the result comes last."""
    attributes = {
        "title": f"jcontour tune: start against tuned weights, machine with {job.machine.nonsmooth_effects}",
        **run_folder.versions(),
    }
    dataset = rollouts(
        replays, job.scenarios, job.machine.axes, job.machine.control_unit, attributes
    )
    save_dataset(dataset, folder / "rollouts.nc")
    job.design.save(job.controller(tuned.weights), job.scenarios, folder)
    points = history_of(job, tuned)
    run_folder.write_json(folder / "history.json", points)
    figures.draw_tuned(dataset, points, summary, folder)
    run_folder.write_json(folder / run_folder.RESULT, summary)


def command(flags: Tune) -> int:
    """The whole command: run, print, exit code."""
    console = tables.console_of(quiet=flags.json)
    try:
        summary, folder = run(flags, console)
    except RuntimeError as error:
        print(f"jcontour: {error}", file=sys.stderr)
        return 1
    return finished(folder, summary, flags, tables.show_tuned)
