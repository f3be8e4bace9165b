"""`jcontour simulate`: one controller on one contour, on the nominal plant and the rest of its family; of a gantry a video too."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments import runs, tables
from experiments.choices import design_for, job_named, machine_named
from experiments.designs import Design, plain_weights
from experiments.gantry_machines import GantryMachine
from experiments.jobs import Pace
from experiments.machines import Machine
from experiments.options import Simulate
from experiments.replays import Course, Replay, Watch, replay


def run(flags: Simulate) -> tuple[dict[str, Any], Path]:
    """Simulate and store; the summary and the run folder.

    Raises:
        ValueError: bad input; nothing has been written then.
    """
    machine = machine_named(flags.plant)
    watch = _pose_of(machine) if flags.video else None
    design = design_for(machine, flags)
    job = job_named(flags.contour or machine.usual.simulated, Pace.of(flags, machine))
    course = Course.of([job], [False], machine, design.measured, design.preview)
    found = replay(design.build(design.start), course, watch)
    inputs = [Path(name) for name in (flags.plant, flags.contour) if name and Path(name).suffix]
    folder = runs.create(flags.out or runs.default_folder("simulate"), "simulate", flags, inputs)
    summary = runs.plain(_summary(design, course, found))
    _store(machine, course, found, folder, summary)
    if isinstance(machine, GantryMachine) and flags.video:
        summary["video"] = _filmed(machine, course, found, folder, f"{design.name} on {summary['contour']}")
        runs.write_json(folder / runs.RESULT, summary)
    return summary, folder


def command(flags: Simulate) -> int:
    """The whole command: run, print, exit code."""
    summary, folder = run(flags)
    if flags.json:
        print(runs.json_text({"run": str(folder), **summary}))
    else:
        console = tables.console_of()
        console.print(tables.plant_table(summary))
        tables.say(console, *_video_lines(summary, folder), f"Run folder: {folder}")
    failure = summary.get("video", {}).get("failure")
    if failure:
        raise ValueError(f"{failure}; the rest of the run is in {folder}")
    return 0


def _pose_of(machine: Machine) -> Watch:
    if not isinstance(machine, GantryMachine):
        raise ValueError(f"video: needs a gantry, whose MuJoCo model is drawn; there is none of {machine.name}")
    from experiments.gantry_video import pose

    return pose


def _filmed(machine: GantryMachine, course: Course, found: Replay, folder: Path, title: str) -> dict[str, Any]:
    """What is known of the video; its failure, where there is none: the run itself is good."""
    from experiments.gantry_video import VideoError, film_of, record

    try:
        return runs.plain(record(machine.parameters, film_of(course, found, title), folder))
    except VideoError as error:
        return {"failure": str(error)}


def _video_lines(summary: dict[str, Any], folder: Path) -> list[str]:
    video = summary.get("video", {})
    if "file" not in video:
        return []
    from experiments.gantry_video import lines

    return lines(video, folder)


def _summary(design: Design, course: Course, found: Replay) -> dict[str, Any]:
    metrics = {
        plant: {name: np.asarray(values)[0, k] for name, values in vars(found.metrics).items()} for k, plant in enumerate(course.plants)
    }
    machine, job = design.machine, course.jobs[0]
    return {
        "machine": {"name": machine.name, "control_unit": machine.control_unit, "axes": machine.axes, "truth": machine.truth},
        "controller": design.name, "weights": plain_weights(design.start), "error": machine.error, "contour": job.name,
        "feed_law": job.feed_law, "samples": job.samples, **design.settings(), "plants": metrics,
    }  # fmt: skip


def _store(machine: Machine, course: Course, found: Replay, folder: Path, summary: dict[str, Any]) -> None:
    from experiments.datasets import rollouts, save_dataset
    from experiments.figures import draw_runs

    attributes = {"title": f"jcontour simulate: {summary['controller']} on {summary['contour']}", **runs.versions()}
    dataset = rollouts({summary["controller"]: found}, course, machine.axes, machine.control_unit, attributes)
    save_dataset(dataset, folder / "rollouts.nc")
    draw_runs(dataset, folder)
    runs.write_json(folder / runs.RESULT, summary)
