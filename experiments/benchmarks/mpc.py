"""`jcontour bench mpc`: time of one step of a constrained controller, by part and by solver."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from experiments.benchmarks.timings import seconds
from experiments.tables import Table
from jcontour.app.flags.others import Bench
from jcontour.geometry.periodic_splines import polar_lobes
from jcontour.host.loop import reported_loop
from jcontour.motion.references import along
from jcontour.mpc.contouring.mpcc import MPCC
from jcontour.plants.xy_table import xy_table
from jcontour.qp.solvers import DAQP, ProxQP, Solver

HORIZONS = (7, 14, 20, 30)
STEPS = 400  # of a closed loop: enough for a 99th percentile, few enough for the slow solvers
WARM = 20  # steps that are not counted
REPEATS = 5  # of every loop: what else the computer does falls on one or two of them
FAST_PERIOD = 1e-4  # [s] the industrial period that the paper names as out of reach
FAST_BLOCKS = (1, 4, 13, 22, 31, 39, 48, 57, 65)  # their ends follow a parabola, up to 28 ms


@dataclass(frozen=True)
class StepTime:
    """Time of one step of a controller, and of its parts [us]."""

    controller: str  # its horizon and, where it is not the paper's, its period
    solver: str
    build: float  # making the QP
    solve: float  # solving and checking it
    step: float  # the whole step, median
    step_99: float  # likewise, 99th percentile
    ratio: float  # step over NumPy's solution of linear equations of that size


def tables(result: list[StepTime]) -> Iterator[Table]:
    """Times of a step and of its parts."""
    columns = {
        "controller": "controller",
        "solver": "solver",
        "build us": "build:.4g",
        "solve and\ncheck us": "solve:.4g",
        "whole step\nmedian us": "step:.4g",
        "99 %\nus": "step_99:.4g",
        "times NumPy's\nlinear solve": "ratio:.4g",
    }
    yield Table("One step of MPCC on the X-Y table, process time", result, columns, words=2)


def measured(flags: Bench, tell: Callable[[str], None]) -> list[StepTime]:
    """Every horizon with DAQP, the paper's with every solver, blocks at the fast period."""
    cases: list[tuple[str, Solver, float, Any]] = [(f"N = {n}", DAQP(), 4e-3, n) for n in HORIZONS]
    cases.append(("N = 7", ProxQP(), 4e-3, 7))
    cases.append(("0.1 ms, 28 ms in 9 blocks", DAQP(), FAST_PERIOD, FAST_BLOCKS))
    steps = []
    for name, solver, period, horizon in cases:
        steps.append(_measured(name, solver, period, horizon))
        tell(f"{name}, {solver.name}: {steps[-1].step:.4g} us per step")
    return steps


def _measured(name: str, solver: Solver, period: float, horizon: Any) -> StepTime:
    contour = polar_lobes(30e-3, 10e-3, 4)
    controller = MPCC(xy_table(period), contour, solver=solver, horizon=horizon)
    reference = along(contour, np.zeros(STEPS + WARM), period, 0, at_rest=True)
    run = reported_loop(xy_table(period), controller, reference)
    states = list(np.asarray(run.rollout.state))
    memories, problems = [controller.initial_memory(reference)], []
    for state in states:
        problems.append(controller.problem(memories[-1], state))
        memories.append(controller.step(memories[-1], None, state)[0])
    samples = list(zip(memories[:-1], states, strict=True))
    build, _ = _times([partial(controller.problem, *sample) for sample in samples])
    step, step_99 = _times([partial(controller.step, memory, None, x) for memory, x in samples])
    solve, _ = _times([partial(solver.solve, problem) for problem in problems])
    linear, _ = _times([partial(np.linalg.solve, problem.H, problem.g) for problem in problems])
    return StepTime(name, solver.name, build, solve, step, step_99, ratio=step / linear)


def _times(calls: list[Callable[[], Any]]) -> tuple[float, float]:
    """Median and 99th percentile [us] of calls, each the median over all rounds."""
    rounds = []
    for _ in range(REPEATS):
        times = [seconds(call, time.process_time) for call in calls]
        rounds.append(times[WARM:])
    median, last = np.median([np.percentile(times, (50, 99)) for times in rounds], axis=0)
    return 1e6 * float(median), 1e6 * float(last)
