"""`jcontour simulate`: one controller on one contour, on the nominal plant and the rest of its family; a video of what can be drawn."""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.catalogue.choices import design_for, job_named, machine_named
from experiments.designs.design import Design, plain_weights
from experiments.files import run_folder
from experiments.jobs.job import Pace
from experiments.jobs.replays import Replay, Scenarios, desired, replay, scored
from experiments.machines.machine import Machine
from experiments.options import Simulate
from experiments.reports import tables
from experiments.video.film import Film, FilmMaker, VideoError, lines


def run(flags: Simulate) -> tuple[dict[str, Any], Path]:
    """Simulate and store; the summary and the run folder.

    Raises:
        ValueError: bad input; nothing has been written then.
    """
    machine = machine_named(flags.plant)
    maker = _film_maker(machine) if flags.video else None
    design = design_for(machine, flags)
    job = job_named(flags.contour or machine.usual.simulated, Pace.of(flags, machine))
    scenarios = Scenarios.of([job], [False], machine, design.fed, design.preview)
    found = replay(design.build(design.start), scenarios, maker and maker.watch)
    inputs = [Path(name) for name in (flags.plant, flags.contour) if name and Path(name).suffix]
    folder = run_folder.create(
        flags.out or run_folder.default_folder("simulate"), "simulate", flags, inputs
    )
    summary = run_folder.plain(_summary(design, scenarios, found))
    _store(machine, scenarios, found, folder, summary)
    if maker:
        summary["video"] = _filmed(
            maker, scenarios, found, folder, f"{design.name} on {summary['contour']}"
        )
        run_folder.write_json(folder / run_folder.RESULT, summary)
    return summary, folder


def command(flags: Simulate) -> int:
    """The whole command: run, print, exit code."""
    summary, folder = run(flags)
    video = summary.get("video", {})
    if flags.json:
        print(run_folder.json_text({"run": str(folder), **summary}))
    else:
        console = tables.console_of()
        console.print(tables.plant_table(summary))
        told = lines(video, folder) if "file" in video else []
        tables.say(console, *told, f"Run folder: {folder}")
    if "failure" in video:
        raise ValueError(f"{video['failure']}; the rest of the run is in {folder}")
    return 0


def film_of(scenarios: Scenarios, found: Replay, title: str) -> Film:
    """The first contour on the nominal plant, from its first scored sample to its last.

    Raises:
        VideoError: the run diverged.
    """
    if np.asarray(found.metrics.diverged)[0, 0]:
        raise VideoError(
            f"video: the run on the {scenarios.plants[0]} plant diverged, there is nothing to show"
        )
    first, last = np.flatnonzero(scored(scenarios)[0])[[0, -1]]
    shown = slice(first, last + 1)
    time = scenarios.references.dt * np.arange(first, last + 1)
    watched, tool, error = (
        np.asarray(rows)[0, 0, shown] for rows in (found.watched, found.output, found.contour_error)
    )
    return Film(time, watched, tool, error, desired(scenarios)[0, shown], title)


def _film_maker(machine: Machine) -> FilmMaker:
    maker = machine.film()
    if maker is None:
        raise ValueError(
            f"video: needs a machine that can be drawn, as a gantry can; {machine.name} cannot"
        )
    return maker


def _filmed(
    maker: FilmMaker, scenarios: Scenarios, found: Replay, folder: Path, title: str
) -> dict[str, Any]:
    """What is known of the video; its failure, where there is none: the run itself is good."""
    try:
        return run_folder.plain(maker.record(film_of(scenarios, found, title), folder))
    except VideoError as error:
        return {"failure": str(error)}


def _summary(design: Design, scenarios: Scenarios, found: Replay) -> dict[str, Any]:
    metrics = {
        plant: {name: np.asarray(values)[0, k] for name, values in vars(found.metrics).items()}
        for k, plant in enumerate(scenarios.plants)
    }
    machine, job = design.machine, scenarios.jobs[0]
    return {
        "machine": {
            "name": machine.name,
            "control_unit": machine.control_unit,
            "axes": machine.axes,
            "truth": machine.nonsmooth_effects,
        },
        "controller": design.name,
        "weights": plain_weights(design.start),
        "error": machine.error,
        "contour": job.name,
        "feed_law": job.feed_law,
        "samples": job.samples,
        **design.settings(),
        "plants": metrics,
    }


def _store(
    machine: Machine, scenarios: Scenarios, found: Replay, folder: Path, summary: dict[str, Any]
) -> None:
    from experiments.files.netcdf import save_dataset
    from experiments.reports.figures import draw_runs
    from experiments.reports.rollouts import rollouts

    attributes = {
        "title": f"jcontour simulate: {summary['controller']} on {summary['contour']}",
        **run_folder.versions(),
    }
    dataset = rollouts(
        {summary["controller"]: found}, scenarios, machine.axes, machine.control_unit, attributes
    )
    save_dataset(dataset, folder / "rollouts.nc")
    draw_runs(dataset, folder)
    run_folder.write_json(folder / run_folder.RESULT, summary)
