"""`jcontour bench`: how long one step of a constrained controller takes, by part and by solver."""

import os
import platform
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import numpy as np

from experiments import runs, tables
from experiments.options import Bench
from jcontour.mpc.contouring import MPCC, growing_blocks
from jcontour.mpc.hildreth import Hildreth
from jcontour.mpc.loop import reported_loop
from jcontour.mpc.qp import QP
from jcontour.mpc.solvers import DAQP, ProxQP, Solver
from jcontour.periodic_splines import polar_lobes
from jcontour.plants.xy_table import xy_table
from jcontour.references import along

HORIZONS = (7, 14, 20, 30)
STEPS = 400  # of a closed loop: enough for a 99th percentile, few enough for the slow solvers
WARM = 20  # steps that are not counted
FAST_PERIOD = 1e-4  # [s] the industrial period that the paper names as out of reach
FAST_BLOCKS = growing_blocks(280, 9)  # 28 ms


def command(flags: Bench) -> int:
    """Measure and print; nothing is asserted."""
    console = tables.console_of(quiet=flags.json)
    with console.status("measuring: keep the computer quiet"):
        summary = runs.plain({"machine": hardware(), "rows": rows()})
    if flags.json:
        print(runs.json_text(summary))
        return 0
    columns = [
        "controller",
        "solver",
        "build us",
        "solve and\ncheck us",
        "whole step\nmedian us",
        "99 %\nus",
        "times NumPy's\nlinear solve",
    ]
    lines = [
        [r["controller"], r["solver"], *(tables.digits(r[n]) for n in ("build", "solve", "step", "step_99", "ratio"))]
        for r in summary["rows"]
    ]
    console.print(tables.plain_table("One step of MPCC on the X-Y table, process time", columns, lines, text_columns=2))
    tables.say(console, *(f"{name:<10} {value}" for name, value in summary["machine"].items()))
    return 0


def hardware() -> dict[str, str]:
    """What the numbers belong to."""
    try:
        with open("/proc/cpuinfo") as file:
            model = next((line.split(":")[1].strip() for line in file if line.startswith("model name")), platform.processor())
    except OSError:
        model = platform.processor() or platform.machine()
    load = f"{os.getloadavg()[0]:.2f}" if hasattr(os, "getloadavg") else "unknown"
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "daqp", "proxsuite", "jax"))
    return {"cpu": f"{model}, {os.cpu_count()} cores", "load": f"{load} (one minute average, before)", "versions": packages,
            "date": time.strftime("%Y-%m-%d")}  # fmt: skip


def rows() -> list[dict[str, Any]]:
    """Every horizon with DAQP, the paper's horizon with every solver, and the fast period with blocked moves."""
    cases: list[tuple[str, Solver, float, Any]] = [(f"N = {n}", DAQP(), 4e-3, n) for n in HORIZONS]
    cases += [("N = 7", solver, 4e-3, 7) for solver in (ProxQP(), Hildreth())]
    cases.append(("0.1 ms, 28 ms in 9 blocks", DAQP(), FAST_PERIOD, FAST_BLOCKS))
    return [_measured(name, solver, period, horizon) for name, solver, period, horizon in cases]


def _measured(name: str, solver: Solver, period: float, horizon: Any) -> dict[str, Any]:
    contour = polar_lobes(30e-3, 10e-3, 4)
    controller = MPCC(xy_table(period), contour, solver=solver, horizon=horizon)
    reference = along(contour, np.zeros(STEPS + WARM), period, 0, at_rest=True)
    rollout = reported_loop(xy_table(period), controller, reference).rollout
    state = np.asarray(rollout.state)
    memory, whole, build, solve = controller.initial_memory(reference), [], [], []
    problems: list[QP] = []
    for k in range(len(state)):
        build.append(_timed(lambda memory=memory, k=k: controller.write_qp(memory, state[k]))[0])
        problems.append(QP(*(np.array(field) for field in controller.qp)))
        spent, (memory, _) = _timed(lambda memory=memory, k=k: controller.step(memory, None, state[k]))
        whole.append(spent)
    for problem in problems:
        solve.append(_timed(lambda problem=problem: solver.solve(problem))[0])
    unconstrained = [_timed(lambda problem=problem: np.linalg.solve(problem.H, problem.g))[0] for problem in problems]
    middle = {part: 1e6 * float(np.median(times[WARM:])) for part, times in (("build", build), ("solve", solve), ("step", whole))}
    return {"controller": name, "solver": solver.name, **middle, "step_99": 1e6 * float(np.percentile(whole[WARM:], 99)),
            "ratio": float(np.median(whole[WARM:]) / np.median(unconstrained[WARM:]))}  # fmt: skip


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    before = time.process_time()
    found = call()
    return time.process_time() - before, found
