"""`jcontour verify RUN`: tuned weights replayed under the limits of the machine, by a constrained MPC with the same weights."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from rich.console import Console

from experiments.designs.lq import TERMINALS, LQDesign
from experiments.files import run_folder
from experiments.files.netcdf import save_dataset
from experiments.machines.machine import Machine
from experiments.options import Tune, Verify
from experiments.reports import tables
from experiments.runs.lifecycle import resumed
from experiments.runs.tuning import TuningRun, tuning_run
from jcontour.controllers.lq.contouring_lq import LQWeights
from jcontour.controllers.observers.kalman import FilterObserver
from jcontour.mpc.limits import Limits
from jcontour.qp.solvers import solver_named
from jcontour.simulation.evaluation import member
from tuning.verify import Gap, Replayed, verify


def command(flags: Verify) -> int:
    """The whole command: replay, print, exit code 1 where a run stopped."""
    folder, tune = resumed(Tune(resume=flags.run), "tune")
    weights = run_folder.read_json(folder, run_folder.RESULT)["weights"]
    job, solver = tuning_run(tune), solver_named(flags.solver)
    design = job.design
    if (
        not isinstance(design, LQDesign)
        or not design.name.startswith("contouring-lq")
        or design.observer is not FilterObserver
    ):
        raise ValueError(
            f"verify: the constrained MPC has the weights of contouring-lq; {folder} tuned {design.name}"
        )
    limits = limits_of(flags, job.machine)
    if not any(bounds is not None for bounds in limits):
        raise ValueError(
            f"verify: {job.machine.name} states no limits; give --max-control, --max-increment, --max-speed-mm-s or another"
        )
    out = run_folder.create(flags.out or run_folder.default_folder("verify"), "verify", flags, [])
    console = tables.console_of(quiet=flags.json)
    replayed = Replayed(
        job.machine.model,
        LQWeights(**weights),
        design.preview,
        design.fed_gain,
        TERMINALS[design.terminal],
    )
    gaps = []
    with console.status("replaying under limits"):
        for gap in verify(
            replayed,
            limits,
            _references(job),
            _plants(job),
            solver,
            None if flags.fallback == "stop" else flags.fallback,
        ):
            gaps.append(_row(gap))
            _save(gap, len(gaps), job.machine, out)
            run_folder.write_json(out / "gaps.json", gaps)  # kept if the rest is interrupted
    summary = run_folder.plain(
        {
            "tuned": str(folder),
            "weights": weights,
            "solver": solver.name,
            "limits": limits._asdict(),
            "gaps": gaps,
        }
    )
    run_folder.write_json(out / run_folder.RESULT, summary)
    if flags.json:
        print(run_folder.json_text({"run": str(out), **summary}))
    else:
        show(summary, console)
        tables.say(console, f"Run folder: {out}")
    return 1 if any(gap["failure"] for gap in gaps) else 0


def limits_of(flags: Verify, machine: Machine) -> Limits:
    """The machine's limits, each replaced where a flag gives another.

    Raises:
        ValueError: a limit is not finite and above zero.
    """
    given = {
        "control": flags.max_control,
        "increment": flags.max_increment,
        "acceleration": flags.max_acceleration,
        "speed": None if flags.max_speed_mm_s is None else 1e-3 * flags.max_speed_mm_s,
    }
    for name, value in given.items():
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"max-{name}: needs to be finite and above zero, received {value}")
    return Limits.within(
        **{
            name: getattr(machine.limits, name) if value is None else value
            for name, value in given.items()
        }
    )


def _references(job: TuningRun) -> dict[str, Any]:
    return {
        one.name: one.reference(job.machine.model.dt, job.design.preview)
        for one in job.scenarios.jobs
    }


def _plants(job: TuningRun) -> dict[str, Any]:
    return {name: member(job.scenarios.family, k) for k, name in enumerate(job.scenarios.plants)}


def _row(gap: Gap) -> dict[str, Any]:
    return run_folder.plain(
        {
            "contour": gap.contour,
            "plant": gap.plant,
            "active_fraction": gap.active_fraction,
            "acting_fraction": gap.acting_fraction,
            "residual": gap.residual,
            "fallbacks": gap.fallbacks,
            "stopped": gap.stopped,
            "failure": gap.failure,
            "without": {name: np.asarray(value) for name, value in vars(gap.without).items()},
            "within": None
            if gap.within is None
            else {name: np.asarray(value) for name, value in vars(gap.within).items()},
        }
    )


def _save(gap: Gap, number: int, machine: Machine, folder: Path) -> None:
    """The constrained run, or what there is of one that stopped."""
    rollout, report = gap.run.rollout, gap.run.report
    if rollout.output is None:
        return
    time = machine.model.dt * np.arange(len(rollout.output))
    data = {
        "output": (("time", "axis"), np.asarray(rollout.output), {"units": "m"}),
        "control": (
            ("time", "input"),
            np.asarray(rollout.control),
            {"units": machine.control_unit},
        ),
        "active": (
            ("time",),
            report.active,
            {"long_name": "limits active in the plan of the step"},
        ),
        "residual": (
            ("time",),
            report.residual,
            {"long_name": "largest scaled residual of the QP"},
        ),
        "fallback": (
            ("time",),
            report.fallback.astype("i1"),
            {"long_name": "1 where the fallback acted"},
        ),
    }
    title = {
        "title": "jcontour verify: under limits",
        "contour": gap.contour,
        "plant": gap.plant,
        "failure": gap.failure,
        **run_folder.versions(),
    }
    coordinates = {"time": ("time", time, {"units": "s"}), "axis": list(machine.axes)}
    save_dataset(
        xr.Dataset(data, coordinates, title), folder / f"run-{number:02d}-{gap.contour}.nc"
    )


def show(summary: dict[str, Any], console: Console) -> None:
    """The gap table, then what stopped."""
    columns = [
        "contour",
        "plant",
        "limit in\nplan %",
        "limit\nacts %",
        "contour\nas tuned",
        "um RMS\nlimited",
        "tracking\nas tuned",
        "um RMS\nlimited",
        "worst\nresidual",
        "fall-\nbacks",
        "stopped\nat step",
    ]
    rows = []
    for gap in summary["gaps"]:
        errors = [
            "-" if gap[kind] is None else tables.digits(1e6 * gap[kind][name])
            for name in ("rms_contour_error", "rms_tracking_error")
            for kind in ("without", "within")
        ]
        stopped = "" if gap["stopped"] is None else str(gap["stopped"])
        limited = [tables.digits(100 * gap[f"{kind}_fraction"]) for kind in ("active", "acting")]
        solving = [f"{gap['residual']:.1e}", str(gap["fallbacks"]), stopped]
        rows.append([gap["contour"], gap["plant"], *limited, *errors, *solving])
    names = ", ".join(name for name, bounds in summary["limits"].items() if bounds is not None)
    title = f"Tuned weights under limits on {names} ({summary['solver']})"
    console.print(tables.plain_table(title, columns, rows, text_columns=2))
    tables.say(
        console,
        "limit in plan: steps whose horizon touches a limit; limit acts: steps whose own control, or its change, is at one",
    )
    for gap in summary["gaps"]:
        if gap["failure"]:
            tables.say(
                console,
                f"STOPPED: {gap['contour']}, {gap['plant']}: {gap['failure']} (--fallback hold or soft goes on)",
            )
    active = [gap for gap in summary["gaps"] if gap["active_fraction"] > 0]
    if not active:
        tables.say(
            console, "No limit was ever active: the tuned controller itself keeps to all of them."
        )
