"""What the names on a command line stand for: a machine, a job for it, a controller that suits it."""

from dataclasses import replace
from pathlib import Path

from experiments.catalogue.contours import CONTOURS
from experiments.catalogue.controllers import CONSTRAINED, CONTROLLERS
from experiments.catalogue.machines import MACHINES, NEEDS
from experiments.designs.design import Design, changed
from experiments.jobs.job import Pace, Task, from_file
from experiments.machines.from_file import load_machine
from experiments.machines.machine import Machine
from experiments.options import Controlled


def machine_named(name: str) -> Machine:
    """Machine of a catalogue name or a file.

    Raises:
        MachineError: no such name, and no such file or a bad one.
    """
    if name in MACHINES:
        return MACHINES[name]()
    if not Path(name).suffix:
        raise ValueError(
            f"plant: there is none named {name!r}; give {', '.join(MACHINES)}, or a JSON or npz file"
        )
    return load_machine(name)


def job_named(name: str, pace: Pace) -> Task:
    """Job of a catalogue name or a toolpath file.

    Raises:
        ValueError: no such name, and no such file or a bad one.
    """
    if name in CONTOURS:
        return CONTOURS[name].make(pace)
    if not Path(name).suffix:
        raise ValueError(
            f"contour: there is none named {name!r}; give one of {', '.join(CONTOURS)}, or a toolpath file"
        )
    return from_file(Path(name), pace)


def controllers_for(machine: Machine) -> list[str]:
    """Names of the controllers that suit a machine."""
    return [name for name, entry in CONTROLLERS.items() if NEEDS[entry.on].met_by(machine)]


def design_for(machine: Machine, flags: Controlled) -> Design:
    """The controller that the flags name, for this machine; its start has been built once, on the host.

    A name goes to the machine's own controller of that name first: `cascade` is `gantry-cascade` on
    a gantry.

    Raises:
        ValueError: no such controller, it does not suit the machine, or a weight is wrong.
    """
    asked = flags.controller or machine.usual.controller
    name = next(
        (own for prefix in machine.own if (own := f"{prefix}-{asked}") in CONTROLLERS), asked
    )
    if name in CONSTRAINED:
        raise ValueError(
            f"controller: {name} chooses its own speed, nothing is tuned of it; "
            "run it with `jcontour trace`"
        )
    if name not in CONTROLLERS:
        raise ValueError(
            f"controller: there is none named {name!r}; give one of {', '.join(controllers_for(machine))}"
        )
    entry = CONTROLLERS[name]
    need = NEEDS[entry.on]
    if not need.met_by(machine):
        raise ValueError(
            f"controller: {name} needs {need.words}; {machine.name} takes {machine.usual.controller}"
        )
    design = entry.make(name, machine, flags)
    design = replace(design, start=changed(design.start, flags.weights))
    design.build(design.start)
    return design
