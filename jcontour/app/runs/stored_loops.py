"""Loops of stored runs: machine, controller and contours of a run of `tune` or `simulate`."""

from dataclasses import dataclass, fields, replace
from pathlib import Path

from jcontour.app.catalogue.choices import design_for, job_named, machine_named, seeing_all
from jcontour.app.designs.design import plain_weights, with_values
from jcontour.app.files import run_folder
from jcontour.app.flags.loops import Simulate
from jcontour.app.flags.shared import Controlled
from jcontour.app.flags.tuning import Tune
from jcontour.app.jobs.job import Pace, Task
from jcontour.app.machines.machine import Fed, Machine
from jcontour.app.runs.lifecycle import WHERE, resumed, stored_flags
from jcontour.app.runs.tuning.problem import TuningRun, tuning_run
from jcontour.controller import Controller
from tuning.parameters import Weights


@dataclass(frozen=True)
class StoredLoop:
    """A controller with its weights on a machine, and what it was run on."""

    machine: Machine
    name: str  # of the controller
    controller: Controller
    fed: Fed  # the machine's sensors or its state
    jobs: tuple[Task, ...]  # contours that it was simulated on, or trained on
    parts: tuple[str, ...]  # names or files of the contours
    pace: Pace  # that they are run at
    weights: tuple[str, ...] = ()  # a line for each, with its unit, as it is typed into a drive
    tuned: bool = False  # whether the weights are those of a run of `tune`


def stored_loop(folder: Path) -> StoredLoop:
    """Loop of a run folder, with the folder's own copies of its files."""
    command = run_folder.read_json(folder, run_folder.SETTINGS).get("command")
    if command == "tune":
        run, weights = stored_tuning(folder)
        flags = run.flags
        design, jobs = run.design, tuple(run.scenarios.jobs_seen(True))
        controller, pace = run.controller(weights), Pace.of(flags, run.machine)
        parts = flags.parts or run.machine.usual.training
        lines = tuple(design.lines(plain_weights(weights)))
        return StoredLoop(
            run.machine, design.name, controller, design.fed, jobs, parts, pace, lines, True
        )
    if command == "simulate":
        flags = stored_flags(folder, "simulate", Simulate)
        return loop_of(flags, flags.contour)
    raise run_folder.RunError(
        f"{folder}: holds a run of {command!r}; a loop is stored by 'tune' and 'simulate'"
    )


def loop_named(flags: Controlled, part: str | None) -> StoredLoop:
    """Loop of a run folder, where the part is one; else that of the flags on the part."""
    if part is None or not Path(part).is_dir():
        return loop_of(flags, part)
    left_out = {one.name: one.default for one in fields(flags)}
    for one in fields(Controlled):
        if one.name not in WHERE and getattr(flags, one.name) != left_out[one.name]:
            flag = one.name.replace("_", "-")
            raise ValueError(f"{flag}: the run in {part} has its own settings; leave it out")
    return stored_loop(Path(part))


def stored_tuning(folder: Path) -> tuple[TuningRun, Weights]:
    """Tuning run of a folder, of the controller that it recommends, and its tuned weights."""
    _, flags = resumed(Tune(resume=folder), "tune")
    result = run_folder.read_json(folder, run_folder.RESULT)
    run = tuning_run(replace(flags, controller=flags.controller or result["controller"]))
    named = {name: value for name, value in result["weights"].items() if value is not None}
    return run, with_values(run.start, named)


def loop_of(flags: Controlled, part: str | None) -> StoredLoop:
    """Loop of the controller that flags name, with its first weights, on one part."""
    machine = machine_named(flags.plant)
    part, pace = part or machine.usual.simulated, Pace.of(flags, machine)
    job = job_named(part, pace)
    design = design_for(machine, seeing_all(flags, job))
    controller = design.complete(design.start)
    lines = tuple(design.lines(plain_weights(design.start)))
    return StoredLoop(machine, design.name, controller, design.fed, (job,), (part,), pace, lines)
