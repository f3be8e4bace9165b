"""The best that each training contour allows alone: what the objective `regret` compares with."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import equinox as eqx
import jax
import numpy as np

from jcontour.app.files import run_folder
from jcontour.app.runs.tuning.limits import counted, probed_loops
from jcontour.app.runs.tuning.problem import OBJECTIVES, TuningRun
from tuning.objectives import AtMost, Regret
from tuning.problem import Problem
from tuning.tune import TuneState, tune

BEST = "best-alone.json"


def with_regret(run: TuningRun, folder: Path, show: Callable[[TuneState], None]) -> TuningRun:
    """The run with its objective against the best of every contour alone.

    Each is found by tuning for that contour under the same limits. What is found is kept in the
    run folder: an interrupted run goes on with the next contour.

    Raises:
        ValueError: no weights are sound on a contour.
    """
    jobs = run.learned
    best: dict[str, float] = run_folder.read_json(folder, BEST) if (folder / BEST).exists() else {}
    for index, job in enumerate(jobs):
        if job.name in best:
            continue
        found = tune(_alone(run, index), run.start, run.settings, show)
        error = getattr(found.outcome.metrics, f"rms_{run.machine.error}_error")
        best[job.name] = float(error.max())
        run_folder.write_json(folder / BEST, best)
    objective = Regret(np.array([best[job.name] for job in jobs]), run.machine.error)
    return replace(run, problem=eqx.tree_at(lambda p: p.objective, run.problem, objective))


def _alone(run: TuningRun, index: int) -> Problem:
    """The problem with one training contour and its own probes."""
    problem = run.problem
    references = jax.tree.map(lambda leaf: leaf[index : index + 1], problem.references)
    objective = OBJECTIVES["typical", run.machine.error]
    limits = problem.limits
    if isinstance(limits, AtMost):
        limits = limits.of_contour(index)
    alone = replace(problem, references=references, objective=objective, limits=limits)
    count = counted(run.limits, run.machine)
    return replace(alone, loops=probed_loops(run.flags, alone, run.machine.doubt, count))
