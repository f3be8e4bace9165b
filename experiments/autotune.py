"""`jcontour tune`: weights of the contouring controller by gradient, with everything an engineer needs to trust them."""

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from rich.console import Console

from experiments import figures, runs, tables
from experiments.checkpoints import load_state, save_state
from experiments.datasets import rollouts, save_dataset, save_gains
from experiments.options import Tune
from experiments.progress import progress_of
from experiments.replays import Replay, replay
from experiments.safety import limit_warnings, path_margins
from experiments.tuning_runs import PLENTY, TuningRun, flag_paths, named_limits, resumed, tuning_run
from jcontour.controllers.contouring_lq import LQWeights
from jcontour.evaluation import member
from jcontour.simulation import prepared
from tuning.parameters import Chart
from tuning.tune import Tuned, TuneState, advance, result

MUCH_LAG = 5.0  # times the tracking error of the start, from which on there is a warning


def run(flags: Tune, console: Console) -> tuple[dict[str, Any], Path]:
    """Tune, or go on tuning; the summary and the run folder.

    Raises:
        ValueError: bad input; nothing has been written then.
    """
    folder, flags, job = _resumed(flags) if flags.resume else _created(flags)
    with runs.locked(folder), runs.resumable("tune", folder):
        describe(job, console)
        return _tuned(job, folder, console), folder


def _created(flags: Tune) -> tuple[Path, Tune, TuningRun]:
    job = tuning_run(flags)
    folder = runs.default_folder("tune") if flags.out is None else flags.out
    return runs.create(folder, "tune", replace(flags, json=False, out=None), flag_paths(flags)), flags, job


def _resumed(flags: Tune) -> tuple[Path, Tune, TuningRun]:
    folder, flags = resumed(flags, "tune")
    return folder, flags, tuning_run(flags)


def _tuned(job: TuningRun, folder: Path, console: Console) -> dict[str, Any]:
    began = time.perf_counter()
    with ThreadPoolExecutor(1) as beside:
        start = beside.submit(_proved, job, job.start)  # compiles on the second core while the tuner descends
        tuned, state = _descended(job, folder, console)
        proofs = {"start": start.result(), "tuned": _proved(job, tuned.weights)}
    summary = summarise(job, tuned, state, proofs)
    summary["seconds"] = time.perf_counter() - began
    store(job, summary, tuned, {name: proof.replay for name, proof in proofs.items()}, folder)
    return summary


def _descended(job: TuningRun, folder: Path, console: Console) -> tuple[Tuned, TuneState]:
    state = load_state(folder)
    with progress_of(console, job.settings) as show:
        while not state.done:
            state = advance(job.problem, job.start, job.settings, state)
            save_state(folder, state)
            show(state)
    try:
        return result(job.problem, job.start, state), state
    except ValueError as error:
        raise RuntimeError(f"no result: {error}; the points tried are kept in {folder}") from None


class Proof(NamedTuple):
    """What weights do on the machines with quantised encoders, and how safe their loops are."""

    replay: Replay
    safety: dict[str, Any]


def _proved(job: TuningRun, weights: LQWeights) -> Proof:
    controller = job.controller(weights)
    return Proof(replay(controller, job.course), path_margins(controller, job.machine, job.course))


def describe(job: TuningRun, console: Console) -> None:
    """Say what is tuned."""
    machine, model, flags = job.machine, job.machine.model, job.flags
    free = "alpha, beta" + (", stage profile" if flags.stage_profile else "")
    limits = ", ".join(f"{name} <= {value:.6g}" for name, value in named_limits(flags).items()) or "none"
    seen = [one for one, trained in zip(job.course.jobs, job.course.training, strict=True) if trained]
    unseen = [one for one, trained in zip(job.course.jobs, job.course.training, strict=True) if not trained]
    lines = [
        f"Machine     {machine.name}: {model.states} states (known delay {machine.known_delay}), axes {', '.join(machine.axes)}, "
        f"dt {1e3 * model.dt:g} ms",
        f"Measured    positions only, encoder {1e6 * machine.encoder_resolution:g} um; Kalman filter for {machine.control_noise:g} "
        f"{machine.control_unit} of noise on every control",
        f"Family      {'; '.join(job.course.plants)}" + (" (tuned on the nominal plant alone)" if flags.nominal_only else ""),
        "Training    " + "; ".join(f"{one.name} ({one.arc.size} samples, {one.feed_law})" for one in seen),
        "Held out    " + "; ".join(f"{one.name} ({one.arc.size} samples)" for one in unseen),
        f"Controller  receding-horizon LQ contouring, preview {flags.preview}, {flags.terminal} terminal",
        f"Free        {free}; start alpha {flags.alpha:g}, beta {flags.beta:g}, rho {flags.rho:g} (fixed)",
        f"Objective   {flags.objective} RMS contour error over training contours and {'the plant' if flags.nominal_only else 'family'}; "
        f"limits: {limits}",
        "Tuned on encoders without quantisation (they have a slope); the tables below are of the quantised machine.",
    ]
    if job.training_samples > PLENTY:
        lines.append(f"{job.training_samples} training samples: this takes longer than a minute.")
    tables.say(console, *lines)


def summarise(job: TuningRun, tuned: Tuned, state: TuneState, proofs: dict[str, Proof]) -> dict[str, Any]:
    """The result in plain numbers."""
    replays, safety = {name: proof.replay for name, proof in proofs.items()}, proofs["tuned"].safety
    warnings = [*_run_warnings(tuned, safety), *limit_warnings(replays["tuned"], job.course, job.machine)]
    warnings += _lag_warnings(job, replays)
    lost = bool(np.any(replays["tuned"].metrics.diverged))
    if lost:
        warnings.insert(0, "a run of the quantised machine diverges with the tuned weights")
    return runs.plain({
        "machine": {"name": job.machine.name, "control_unit": job.machine.control_unit, "axes": job.machine.axes},
        "preview": job.flags.preview, "terminal": job.flags.terminal,
        "start": weights_of(job.start), "weights": weights_of(tuned.weights),
        "feasible": tuned.feasible, "violation": tuned.violation if np.isfinite(tuned.violation) else None,
        "usable": bool(tuned.feasible and not lost and safety["largest_frozen_spectral_radius"] < 1),
        "limits": named_limits(job.flags),
        "evaluated_points": len(tuned.history), "diverged_points": tuned.diverged_points, "diverged_starts": tuned.diverged_starts,
        "descents": state.start + 1, "plants": job.course.plants, "safety": safety,
        "safety_of_start": proofs["start"].safety, "warnings": warnings,
        "contours": contour_metrics(job, replays), "training_samples": job.training_samples,
    })  # fmt: skip


def weights_of(weights: LQWeights) -> dict[str, Any]:
    """Weights as numbers."""
    stage = None if weights.stage is None else np.asarray(weights.stage).tolist()
    return {"alpha": float(weights.alpha), "beta": float(weights.beta), "rho": float(weights.rho), "stage": stage}


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
        rows.append({"name": one.name, "training": bool(trained), "samples": one.arc.size, "metrics": metrics})
    return rows


def _run_warnings(tuned: Tuned, safety: dict[str, Any]) -> list[str]:
    lines = []
    if not tuned.feasible:
        lines.append(f"no feasible point was found; these weights exceed a limit by {100 * np.expm1(tuned.violation):.3g} %")
    if safety["largest_frozen_spectral_radius"] >= 1:
        lines.append("a frozen loop along the training paths is unstable")
    if tuned.diverged_points:
        lines.append(f"{tuned.diverged_points} of {len(tuned.history)} evaluated points had a diverging plant and were rejected")
    if tuned.diverged_starts:
        lines.append(f"{tuned.diverged_starts} descents could not begin because their start diverges")
    return lines


def _lag_warnings(job: TuningRun, replays: dict[str, Replay]) -> list[str]:
    """Contour error alone is also small for a tool that hardly moves: say so where the tuned tool lags far more than before."""
    before, after = (1e6 * np.asarray(replays[name].metrics.rms_tracking_error).max(axis=1) for name in ("start", "tuned"))
    worst = int(np.argmax(after / before))
    if after[worst] < MUCH_LAG * before[worst]:
        return []
    return [
        f"the tool lags {after[worst]:.4g} um behind on {job.course.jobs[worst].name} (start: {before[worst]:.4g} um): contour error alone "
        "does not mind; limit it with --max-tracking-error-um"
    ]


def store(job: TuningRun, summary: dict[str, Any], tuned: Tuned, replays: dict[str, Replay], folder: Path) -> None:
    """Write everything but the settings and the state, which are there; the result comes last."""
    controller = job.controller(tuned.weights)
    attributes = {"title": "jcontour tune: start against tuned weights, machine with quantised encoders", **runs.versions()}
    dataset = rollouts(replays, job.course, job.machine.axes, job.machine.control_unit, attributes)
    save_dataset(dataset, folder / "rollouts.nc")
    for k, (one, trained) in enumerate(zip(job.course.jobs, job.course.training, strict=True)):
        if trained:
            plan = prepared(controller, member(job.course.references, k))
            save_gains(plan, one.arc.size, job.machine.model.dt, folder / ("gains.csv" if k == 0 else f"gains-{one.name}.csv"))
    runs.write_json(folder / "observer.json", observer_of(job))
    points = history_of(job, tuned)
    runs.write_json(folder / "history.json", points)
    figures.draw_tuned(dataset, points, summary, folder)
    runs.write_json(folder / runs.RESULT, summary)


def observer_of(job: TuningRun) -> dict[str, Any]:
    """The Kalman filter as a drive would load it; floats in JSON come back to the last bit."""
    model = job.machine.model
    return {
        "form": "filter: xf = xh + L (y - C xh); u = f - F xf; xh(next) = A xf + B u",
        "units": {"y": "m", "u": job.machine.control_unit},
        "dt": model.dt, "A": model.A, "B": model.B, "C": model.C, "L": job.observer_gain,
        "control_noise": job.machine.control_noise, "measurement_noise": job.machine.measurement_noise,
    }  # fmt: skip


def history_of(job: TuningRun, tuned: Tuned) -> list[dict[str, Any]]:
    """Every evaluated point: weights, objective, worst contour error and increment over training contours and family."""
    chart = Chart(job.problem.space, job.start)
    return [
        {
            "descent": row.start, **weights_of(chart.weights(jnp.asarray(row.z))), "objective": row.objective,
            "violation": row.violation, "diverged": row.diverged,
            "rms_contour_error": float(np.max(row.metrics.rms_contour_error)),
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
        print(runs.json_text({"run": str(folder), **summary}))
    else:
        tables.show_tuned(summary, str(folder), console)
    return 0
