"""`jcontour simulate`: one controller on one contour, on the nominal plant and the rest of its family."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments import runs, tables
from experiments.catalogue import controller_named, job_named, machine_named
from experiments.jobs import Pace
from experiments.machines import Machine
from experiments.options import Simulate
from experiments.replays import Course, Replay, replay
from jcontour.controllers.contouring_lq import LQWeights
from jcontour.plant import Plant


def run(flags: Simulate) -> tuple[dict[str, Any], Path]:
    """Simulate and store; the summary and the run folder.

    Raises:
        ValueError: bad input; nothing has been written then.
    """
    machine = machine_named(flags.plant)
    entry = controller_named(flags.controller)
    weights = LQWeights(flags.alpha, flags.beta, flags.rho)
    job = job_named(flags.contour, Pace.of(flags, machine))
    controller = entry.make(machine, weights, flags.preview)
    course = Course.of([job], [False], _plants(machine, entry.measures), flags.preview)
    found = replay(controller, course)
    inputs = [Path(name) for name in (flags.plant, flags.contour) if Path(name).suffix]
    folder = runs.create(flags.out or runs.default_folder("simulate"), "simulate", flags, inputs)
    summary = runs.plain(_summary(flags, machine, course, found))
    _store(machine, course, found, folder, summary)
    return summary, folder


def command(flags: Simulate) -> int:
    """The whole command: run, print, exit code."""
    summary, folder = run(flags)
    if flags.json:
        print(runs.json_text({"run": str(folder), **summary}))
        return 0
    console = tables.console_of()
    console.print(tables.plant_table(summary))
    tables.say(console, f"Run folder: {folder}")
    return 0


def _plants(machine: Machine, measures: str) -> list[tuple[str, Plant]]:
    """The family behind encoders, or with the whole state measured for controllers that need it."""
    smooth = machine.family(quantised=False)
    plants = machine.family(quantised=True) if measures == "outputs" else [encoders.plant for encoders in smooth]
    return [(name, plant) for (name, _, _), plant in zip(machine.members, plants, strict=True)]


def _summary(flags: Simulate, machine: Machine, course: Course, found: Replay) -> dict[str, Any]:
    metrics = {
        plant: {name: np.asarray(values)[0, k] for name, values in vars(found.metrics).items()} for k, plant in enumerate(course.plants)
    }
    return {
        "machine": {"name": machine.name, "control_unit": machine.control_unit, "axes": machine.axes},
        "controller": flags.controller, "contour": course.jobs[0].name, "feed_law": course.jobs[0].feed_law,
        "samples": course.jobs[0].arc.size, "preview": flags.preview, "plants": metrics,
    }  # fmt: skip


def _store(machine: Machine, course: Course, found: Replay, folder: Path, summary: dict[str, Any]) -> None:
    from experiments.datasets import rollouts, save_dataset
    from experiments.figures import draw_runs

    attributes = {"title": f"jcontour simulate: {summary['controller']} on {summary['contour']}", **runs.versions()}
    dataset = rollouts({summary["controller"]: found}, course, machine.axes, machine.control_unit, attributes)
    save_dataset(dataset, folder / "rollouts.nc")
    draw_runs(dataset, folder)
    runs.write_json(folder / runs.RESULT, summary)
