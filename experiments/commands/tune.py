"""`jcontour tune`: weights of a controller by gradient, with everything an engineer needs to trust them."""

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from rich.console import Console

from experiments.designs.design import plain_weights
from experiments.files import run_folder
from experiments.files.checkpoints import load_state, save_state
from experiments.files.netcdf import rollouts, save_dataset
from experiments.jobs.replays import Replay, replay, scored
from experiments.options import Tune
from experiments.reports import figures, tables
from experiments.reports.progress import progress_of
from experiments.runs.safety import path_margins
from experiments.runs.tuning import PLENTY, TuningRun, flag_paths, resumed, tuning_run
from experiments.runs.warnings import run_warnings
from jcontour.simulation.evaluation import stack_plants
from tuning.parameters import Chart, Weights
from tuning.tune import Tuned, TuneState, advance, result


def run(flags: Tune, console: Console) -> tuple[dict[str, Any], Path]:
    """Tune, or go on tuning; the summary and the run folder.

    Raises:
        ValueError: bad input; nothing has been written then.
    """
    folder, flags, job = _resumed(flags) if flags.resume else _created(flags)
    with run_folder.locked(folder), run_folder.resumable("tune", folder):
        describe(job, console)
        return _tuned(job, folder, console), folder


def _created(flags: Tune) -> tuple[Path, Tune, TuningRun]:
    job = tuning_run(flags)
    folder = run_folder.default_folder("tune") if flags.out is None else flags.out
    return run_folder.create(folder, "tune", replace(flags, json=False, out=None), flag_paths(flags)), flags, job


def _resumed(flags: Tune) -> tuple[Path, Tune, TuningRun]:
    folder, flags = resumed(flags, "tune")
    return folder, flags, tuning_run(flags)


def _tuned(job: TuningRun, folder: Path, console: Console) -> dict[str, Any]:
    began = time.perf_counter()
    with ThreadPoolExecutor(1) as beside:
        start = beside.submit(_proved, job, job.start)  # compiles on the second core while the tuner descends
        tuned, state = _descended(job, folder, console)
        proofs = {"start": start.result(), "tuned": _proved(job, tuned.weights)}
    summary = summarise(job, tuned, state, proofs) | {"confirmed": confirmed(job, tuned, proofs["tuned"].replay)}
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


class Proof(NamedTuple):
    """What weights do on the true machines, and how safe their loops are."""

    replay: Replay
    safety: dict[str, Any]


def _proved(job: TuningRun, weights: Weights) -> Proof:
    controller = job.controller(weights)
    return Proof(replay(controller, job.course), path_margins(controller, job.machine, job.course, job.design.measured))


def describe(job: TuningRun, console: Console) -> None:
    """Say what is tuned."""
    machine, flags, course = job.machine, job.flags, job.course
    limits = ", ".join(f"{name} <= {value:.6g}" for name, value in job.limits.items()) or "none"
    facts = machine.facts() | {
        "Family": "; ".join(course.plants) + (" (tuned on the nominal plant alone)" if flags.nominal_only else ""),
        "Training": "; ".join(f"{one.name} ({one.samples} samples, {one.feed_law})" for one in course.jobs_seen(True)),
        "Held out": "; ".join(f"{one.name} ({one.samples} samples)" for one in course.jobs_seen(False)),
        **job.design.facts(),
        "Objective": f"{flags.objective} RMS {machine.error} error over training contours and "
        f"{'the plant' if flags.nominal_only else 'family'}; limits: {limits}",
    }
    lines = [f"{heading:<11} {fact}" for heading, fact in facts.items()]
    lines.append(f"Tuned without {machine.truth} (they have no slope); the tables below are with them.")
    if job.training_samples > PLENTY:
        lines.append(f"{job.training_samples} training samples: this takes longer than a minute.")
    tables.say(console, *lines)


def summarise(job: TuningRun, tuned: Tuned, state: TuneState, proofs: dict[str, Proof]) -> dict[str, Any]:
    """The result in plain numbers."""
    replays, safety = {name: proof.replay for name, proof in proofs.items()}, proofs["tuned"].safety
    lost, closed = bool(np.any(replays["tuned"].metrics.diverged)), not safety["contours_without_margins"]
    weights = plain_weights(tuned.weights)
    return run_folder.plain({
        "machine": {
            "name": job.machine.name, "control_unit": job.machine.control_unit, "axes": job.machine.axes, "truth": job.machine.truth,
        },
        "controller": job.design.name, "error": job.machine.error, **job.design.settings(),
        "start": plain_weights(job.start), "weights": weights, "values": job.design.values(weights),
        "feasible": tuned.feasible, "violation": tuned.violation if np.isfinite(tuned.violation) else None,
        "usable": bool(tuned.feasible and not lost and closed and safety["largest_frozen_spectral_radius"] < 1),
        "limits": job.limits,
        "evaluated_points": len(tuned.history), "diverged_points": tuned.diverged_points, "diverged_starts": tuned.diverged_starts,
        "descents": state.start + 1, "plants": job.course.plants, "safety": safety,
        "safety_of_start": proofs["start"].safety, "warnings": run_warnings(job, tuned, safety, replays),
        "contours": contour_metrics(job, replays), "gap": gap(job, tuned, replays["tuned"]), "training_samples": job.training_samples,
    })  # fmt: skip


def gap(job: TuningRun, tuned: Tuned, found: Replay) -> list[dict[str, Any]]:
    """What the tuner saw against what the true machines do: RMS error of every training contour, nominal and worst of the tuned family."""
    name = f"rms_{job.machine.error}_error"
    smooth, true = np.asarray(getattr(tuned.metrics, name)), np.asarray(getattr(found.metrics, name))
    rows = []
    for c, one in enumerate(job.course.jobs_seen(True)):
        members = true[c, : smooth.shape[1]]
        for plant, pair in (("nominal", (smooth[c, 0], members[0])), ("worst", (smooth[c].max(), members.max()))):
            rows.append({"contour": one.name, "plant": plant, "smooth": pair[0], "true": pair[1], "relative": pair[1] / pair[0] - 1})
    return rows


def confirmed(job: TuningRun, tuned: Tuned, found: Replay) -> list[dict[str, Any]]:
    """The nominal plant in an engine of others, where there is one: its RMS error, and how far its tool is from ours at most [m]."""
    independent = job.machine.independent()
    if independent is None:
        return []
    engine, plant = independent
    other = replay(job.controller(tuned.weights), job.course._replace(plants=("nominal",), family=stack_plants([plant])))
    name, counts = f"rms_{job.machine.error}_error", scored(job.course)
    apart = np.linalg.norm(other.output[:, 0] - found.output[:, 0], axis=-1)
    return run_folder.plain([
        {
            "engine": engine, "contour": one.name, "ours": getattr(found.metrics, name)[c, 0], "theirs": getattr(other.metrics, name)[c, 0],
            "apart": apart[c][counts[c]].max(),
        }
        for c, one in enumerate(job.course.jobs)
    ])  # fmt: skip


def contour_metrics(job: TuningRun, replays: dict[str, Replay]) -> list[dict[str, Any]]:
    """Per contour and design: metrics of the nominal plant, and the worst of the family metric by metric."""
    rows = []
    for c, (one, trained) in enumerate(zip(job.course.jobs, job.course.training, strict=True)):
        metrics = {
            design: {
                "nominal": {name: np.asarray(values)[c, 0] for name, values in vars(run.metrics).items()},
                "worst": {name: np.asarray(values)[c].max() for name, values in vars(run.metrics).items()},
            }
            for design, run in replays.items()
        }
        rows.append({"name": one.name, "training": bool(trained), "samples": one.samples, "metrics": metrics})
    return rows


def store(job: TuningRun, summary: dict[str, Any], tuned: Tuned, replays: dict[str, Replay], folder: Path) -> None:
    """Write everything but the settings and the state, which are there; the result comes last."""
    attributes = {"title": f"jcontour tune: start against tuned weights, machine with {job.machine.truth}", **run_folder.versions()}
    dataset = rollouts(replays, job.course, job.machine.axes, job.machine.control_unit, attributes)
    save_dataset(dataset, folder / "rollouts.nc")
    job.design.save(job.controller(tuned.weights), job.course, folder)
    points = history_of(job, tuned)
    run_folder.write_json(folder / "history.json", points)
    figures.draw_tuned(dataset, points, summary, folder)
    run_folder.write_json(folder / run_folder.RESULT, summary)


def history_of(job: TuningRun, tuned: Tuned) -> list[dict[str, Any]]:
    """Every evaluated point: weights, objective, worst error and increment over training contours and family."""
    chart, error = Chart(job.problem.space, job.start), f"rms_{job.machine.error}_error"
    return [
        {
            "descent": row.start, **plain_weights(chart.weights(jnp.asarray(row.z))), "objective": row.objective,
            "violation": row.violation, "diverged": row.diverged,
            error: float(np.max(getattr(row.metrics, error))),
            "rms_increment": float(np.max(row.metrics.rms_increment)),
        }
        for row in tuned.history
    ]  # fmt: skip


def command(flags: Tune) -> int:
    """The whole command: run, print, exit code."""
    console = tables.console_of(quiet=flags.json)
    try:
        summary, folder = run(flags, console)
    except RuntimeError as error:
        print(f"jcontour: {error}", file=sys.stderr)
        return 1
    if flags.json:
        print(run_folder.json_text({"run": str(folder), **summary}))
    else:
        tables.show_tuned(summary, str(folder), console)
    return 0
