"""Results of a tuning run: replays, margins, gap to the true machine, history."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from experiments.designs.design import plain_weights
from experiments.files import run_folder
from experiments.jobs.replays import Replay, replay, scored
from experiments.runs.safety import path_margins
from experiments.runs.tuning import TuningRun
from experiments.runs.warnings import run_warnings
from jcontour.simulation.evaluation import stack_plants
from tuning.parameters import Chart, Weights
from tuning.tune import Tuned, TuneState


class Proof(NamedTuple):
    """What weights do on the true machines, and how safe their loops are."""

    replay: Replay
    safety: dict[str, Any]


def proved(job: TuningRun, weights: Weights) -> Proof:
    controller = job.controller(weights)
    return Proof(
        replay(controller, job.scenarios),
        path_margins(controller, job.machine, job.scenarios, job.design.fed),
    )


def summarise(
    job: TuningRun, tuned: Tuned, state: TuneState, proofs: dict[str, Proof]
) -> dict[str, Any]:
    """The result in plain numbers."""
    replays, safety = {name: proof.replay for name, proof in proofs.items()}, proofs["tuned"].safety
    lost, closed = (
        bool(np.any(replays["tuned"].metrics.diverged)),
        not safety["contours_without_margins"],
    )
    weights = plain_weights(tuned.weights)
    return run_folder.plain(
        {
            "machine": {
                "name": job.machine.name,
                "control_unit": job.machine.control_unit,
                "axes": job.machine.axes,
                "truth": job.machine.nonsmooth_effects,
            },
            "controller": job.design.name,
            "error": job.machine.error,
            **job.design.settings(),
            "start": plain_weights(job.start),
            "weights": weights,
            "values": job.design.weight_lines(weights),
            "feasible": tuned.feasible,
            "violation": tuned.violation if np.isfinite(tuned.violation) else None,
            "usable": bool(
                tuned.feasible
                and not lost
                and closed
                and safety["largest_frozen_spectral_radius"] < 1
            ),
            "limits": job.limits,
            "evaluated_points": len(tuned.history),
            "diverged_points": tuned.diverged_points,
            "diverged_starts": tuned.diverged_starts,
            "descents": state.start + 1,
            "plants": job.scenarios.plants,
            "safety": safety,
            "safety_of_start": proofs["start"].safety,
            "warnings": run_warnings(job, tuned, safety, replays),
            "contours": contour_metrics(job, replays),
            "gap": gap(job, tuned, replays["tuned"]),
            "training_samples": job.training_samples,
        }
    )


def gap(job: TuningRun, tuned: Tuned, found: Replay) -> list[dict[str, Any]]:
    """What the tuner saw against what the true machines do: RMS error of every training contour, nominal and worst of the tuned family."""
    name = f"rms_{job.machine.error}_error"
    smooth, true = (
        np.asarray(getattr(tuned.metrics, name)),
        np.asarray(getattr(found.metrics, name)),
    )
    rows = []
    for c, one in enumerate(job.scenarios.jobs_seen(True)):
        members = true[c, : smooth.shape[1]]
        for plant, pair in (
            ("nominal", (smooth[c, 0], members[0])),
            ("worst", (smooth[c].max(), members.max())),
        ):
            rows.append(
                {
                    "contour": one.name,
                    "plant": plant,
                    "smooth": pair[0],
                    "true": pair[1],
                    "relative": pair[1] / pair[0] - 1,
                }
            )
    return rows


def confirmed(job: TuningRun, tuned: Tuned, found: Replay) -> list[dict[str, Any]]:
    """The nominal plant in an engine of others, where there is one: its RMS error, and how far its tool is from ours at most [m]."""
    independent = job.machine.independent()
    if independent is None:
        return []
    engine, plant = independent
    other = replay(
        job.controller(tuned.weights),
        job.scenarios._replace(plants=("nominal",), family=stack_plants([plant])),
    )
    name, counts = f"rms_{job.machine.error}_error", scored(job.scenarios)
    apart = np.linalg.norm(other.output[:, 0] - found.output[:, 0], axis=-1)
    return run_folder.plain(
        [
            {
                "engine": engine,
                "contour": one.name,
                "ours": getattr(found.metrics, name)[c, 0],
                "theirs": getattr(other.metrics, name)[c, 0],
                "apart": apart[c][counts[c]].max(),
            }
            for c, one in enumerate(job.scenarios.jobs)
        ]
    )


def contour_metrics(job: TuningRun, replays: dict[str, Replay]) -> list[dict[str, Any]]:
    """Per contour and design: metrics of the nominal plant, and the worst of the family metric by metric."""
    rows = []
    for c, (one, trained) in enumerate(
        zip(job.scenarios.jobs, job.scenarios.training, strict=True)
    ):
        metrics = {
            design: {
                "nominal": {
                    name: np.asarray(values)[c, 0] for name, values in vars(run.metrics).items()
                },
                "worst": {
                    name: np.asarray(values)[c].max() for name, values in vars(run.metrics).items()
                },
            }
            for design, run in replays.items()
        }
        rows.append(
            {
                "name": one.name,
                "training": bool(trained),
                "samples": one.samples,
                "metrics": metrics,
            }
        )
    return rows


def history_of(job: TuningRun, tuned: Tuned) -> list[dict[str, Any]]:
    """Every evaluated point: weights, objective, worst error and increment over training contours and family."""
    chart, error = Chart(job.problem.space, job.start), f"rms_{job.machine.error}_error"
    return [
        {
            "descent": row.start,
            **plain_weights(chart.weights(jnp.asarray(row.z))),
            "objective": row.objective,
            "violation": row.violation,
            "diverged": row.diverged,
            error: float(np.max(getattr(row.metrics, error))),
            "rms_increment": float(np.max(row.metrics.rms_increment)),
        }
        for row in tuned.history
    ]
