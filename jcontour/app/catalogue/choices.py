"""Machine, task and controller that the names on a command line stand for."""

import warnings
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from jcontour.app.catalogue.contours import CONTOURS
from jcontour.app.catalogue.controllers import CONSTRAINED, CONTROLLERS
from jcontour.app.catalogue.known_names import check_contour, check_plant
from jcontour.app.catalogue.machines import MACHINES
from jcontour.app.catalogue.own_classes import (
    FILE,
    own_controller,
    own_machine,
    own_name,
)
from jcontour.app.designs.design import Design, changed
from jcontour.app.flags.shared import Controlled
from jcontour.app.jobs.job import Pace, Task, from_file
from jcontour.app.machines.from_file import load_machine
from jcontour.app.machines.machine import Machine
from jcontour.app.plain_numbers import WholePath

Flags = TypeVar("Flags", bound=Controlled)
# flags that no controller of the user's reads, and not every one of the catalogue
LQ_FLAGS = ("preview", "terminal", "alpha", "beta", "rho", "model_delay")


def machine_named(name: str) -> Machine:
    """Machine of a catalogue name, a machine file or a plant in a Python file.

    Raises:
        MachineError: no such name, and no such file or a bad one.
    """
    check_plant(name)
    if name in MACHINES:
        return MACHINES[name]()
    own = own_name(name)
    return load_machine(name) if own is None else own_machine(own)


def job_named(name: str, pace: Pace) -> Task:
    """Job of a catalogue name or a toolpath file.

    Raises:
        ValueError: no such name, and no such file or a bad one.
    """
    check_contour(name)
    if name in CONTOURS:
        return CONTOURS[name].make(name, pace)
    return from_file(Path(name), pace)


def controllers_for(machine: Machine) -> list[str]:
    """Names of the controllers that suit a machine."""
    return [name for name, entry in CONTROLLERS.items() if entry.suits(machine)]


@cache
def first_machine(controller: str) -> str:
    """Name of the first machine of the catalogue that a controller suits."""
    suits = CONTROLLERS[controller].suits
    return next(name for name, make in MACHINES.items() if suits(make()))


def design_for(machine: Machine, flags: Controlled) -> Design:
    """The controller that the flags name, for this machine.

    Its start has been built once, on the host.

    An alias of a controller that suits the machine goes first: `cascade` is `gantry-cascade` on a
    gantry.

    Raises:
        ValueError: no such controller, it does not suit the machine, or a weight is wrong.
    """
    if isinstance(flags.preview, WholePath):
        raise ValueError(
            "preview: path is for the one run of simulate, feed, precompensate or learn; the "
            "shortest of several runs bounds it, give a number of samples here"
        )
    asked = flags.controller or machine.usual.controller
    if not asked:
        raise ValueError(f"controller: {machine.name} needs one of your own, --controller {FILE}")
    own = own_name(asked)
    if own is None:
        watched, read = _watched(flags)
        design = _listed_design(asked, machine, watched)
        _warn_of_unread(design.name, flags, read, "")
    else:
        design = own_controller(own, machine)
        why = ": its preview is its own, and --weights sets its fields"
        _warn_of_unread(str(own), flags, set(), why)
    design = replace(design, start=changed(design.start, flags.weights))
    design.build(design.start)
    return design


class UnreadFlagWarning(UserWarning):
    """A controller does not read a flag that is given."""


def _watched(flags: Flags) -> tuple[Flags, set[str]]:
    """The same flags, and the names of those that have been read of them so far."""
    read: set[str] = set()
    kind: Any = type(flags)

    class Watched(kind):
        def __getattribute__(self, name: str) -> Any:
            read.add(name)
            return super().__getattribute__(name)

    return cast(Flags, Watched(**vars(flags))), read


def _warn_of_unread(name: str, flags: Controlled, read: set[str], why: str) -> None:
    """Warn of flags of LQ controllers that are given, and that this controller does not read."""
    unread = [
        flag for flag in LQ_FLAGS if flag not in read and getattr(flags, flag) != _usual(flag)
    ]
    if unread:
        words = ", ".join(f"--{flag.replace('_', '-')}" for flag in unread)
        warnings.warn(f"{name} does not read {words}{why}", UnreadFlagWarning, stacklevel=3)


def read_by(name: str, flags: Flags) -> Flags:
    """Flags of many controllers as one of them reads them: one of the user's own has the usual."""
    if own_name(name) is None:
        return flags
    return replace(flags, **{flag: _usual(flag) for flag in LQ_FLAGS})


def names_controller(flags: Controlled) -> bool:
    """Whether the user names a controller, or numbers that a usual one alone reads."""
    numbers = any(getattr(flags, flag) != _usual(flag) for flag in LQ_FLAGS)
    return numbers or flags.controller is not None or bool(flags.weights)


def _usual(flag: str) -> Any:
    return next(one.default for one in fields(Controlled) if one.name == flag)


def seeing_all(flags: Flags, job: Task) -> Flags:
    """The flags; where their preview is the whole path, with as many samples as the run has.

    Every step then sees all that is left of the run, and how it goes on behind its end.
    """
    whole = isinstance(flags.preview, WholePath)
    return replace(flags, preview=job.samples) if whole else flags


def _listed_design(asked: str, machine: Machine, flags: Controlled) -> Design:
    meant = [name for name in controllers_for(machine) if CONTROLLERS[name].alias == asked]
    name = meant[-1] if meant else asked
    if name in CONSTRAINED:
        entry = CONSTRAINED[name]
        raise ValueError(f"controller: {name} {entry.why}; run it with `jcontour {entry.command}`")
    if name not in CONTROLLERS:
        raise ValueError(
            f"controller: there is none named {name!r}; "
            f"give one of {', '.join(controllers_for(machine))}"
        )
    entry = CONTROLLERS[name]
    if not entry.suits(machine):
        raise ValueError(
            f"controller: {name} needs {entry.suits.words}; "
            f"{machine.name} takes {machine.usual.controller or f'one of your own, {FILE}'}"
        )
    return entry.make(name, machine, flags)
