"""Machine, task and controller that the names on a command line stand for."""

import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import jax.numpy as jnp
import numpy as np

from jcontour.app.catalogue.entries import (
    CONSTRAINED,
    CONTOURS,
    CONTROLLERS,
    MACHINES,
    PREFIXES,
    design_class,
)
from jcontour.app.catalogue.known_names import check_contour, check_plant
from jcontour.app.catalogue.own_classes import (
    FILE,
    own_controller,
    own_machine,
    own_name,
)
from jcontour.app.designs.design import (
    SETTINGS,
    Design,
    Needs,
    OwnDesign,
    first_line,
    given,
    made,
)
from jcontour.app.flags.shared import Controlled
from jcontour.app.jobs.job import Pace, Task, from_file
from jcontour.app.machines.machine import Machine
from jcontour.app.plain_numbers import WholePath

RINGS = 0.6  # damping ratio up to which a mode overshoots by a tenth
SETTLING = 0.5  # [s] that integrals have to settle where a reference stands
Flags = TypeVar("Flags", bound=Controlled)


def machine_named(name: str) -> Machine:
    """Machine of a catalogue name, a machine file or a plant in a Python file.

    Raises:
        MachineError: no such name, and no such file or a bad one.
    """
    check_plant(name)
    if name in MACHINES:
        return MACHINES[name]()
    if (own := own_name(name)) is not None:
        return own_machine(own)
    from jcontour.app.machines.from_file import load_machine  # its schema takes a while

    return load_machine(name)


def job_named(name: str, pace: Pace) -> Task:
    """Job of a catalogue name or a toolpath file."""
    check_contour(name)
    if name in CONTOURS:
        return CONTOURS[name].load()[name](pace)
    return from_file(Path(name), pace)


def controllers_for(machine: Machine) -> list[str]:
    """Names of the controllers that suit a machine."""
    return [name for name in CONTROLLERS if _needs(name).met_by(machine)]


def learns(name: str) -> bool:
    """Whether a controller changes while it runs: no margin is known of what it learns."""
    return getattr(design_class(name), "learns", False)


def _needs(name: str) -> Needs:
    return getattr(design_class(name), "needs", OwnDesign.needs)


class UnreadFlagWarning(UserWarning):
    """A controller does not read a flag that is given."""


def design_for(machine: Machine, flags: Controlled) -> Design:
    """The controller that the flags name, for this machine.

    Its start has been built once, on the host.
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
        name = _listed_name(asked, machine)
        described = design_class(name)
        if issubclass(described, Design):
            design = described(name, machine, flags)
        else:
            controller = made(described, machine.model, flags.horizon(machine.model.dt))
            design = OwnDesign(name, first_line(described), controller, machine, flags)
    else:
        design = own_controller(own, machine, flags)
    unread = [flag for flag in set_of(flags) if flag not in design.reads]
    if unread:
        words = ", ".join(f"--{flag.replace('_', '-')}" for flag in unread)
        warnings.warn(f"{design.name} does not read {words}", UnreadFlagWarning, stacklevel=2)
    design = _compensated(design, machine, flags.backlash)
    design.complete(design.start)
    return design


def _compensated(design: Design, machine: Machine, backlash: bool) -> Design:
    """The design with the control against known dry friction, and with motors that lead.

    The motors lead by half the backlash, where that is asked for.
    """
    linear = machine.linear
    if linear is not None and linear.largest_friction:
        design = _against_friction(design, machine)
    if not backlash:
        return design
    if linear is None or not np.any(linear.backlash):
        raise ValueError(f"backlash: {machine.name} states none; a machine file may")
    from jcontour.controllers.wrappers.adapters import BacklashCompensation

    leading = partial(BacklashCompensation, gap=jnp.asarray(linear.gaps))
    return design.replaced(compensation=(*design.compensation, leading))


def _against_friction(design: Design, machine: Machine) -> Design:
    """The design with the control against dry friction, which ramps where an axis reverses.

    It takes the longest period of a mode, as no mode rings behind a ramp of its own period, or the
    delay before the reversal and as long behind it. Where the control may not change that fast,
    friction is left to the feedback.
    """
    from jcontour.controllers.feedforward.inverse_feedforward import FrictionFeedforward

    linear = machine.linear
    assert linear is not None
    limit, change = linear.limits.control, linear.limits.increment
    late = linear.known_delay + linear.middle_delay
    settled = round(SETTLING / linear.model.dt)
    turning = max(2 * late, _longest_period(np.asarray(linear.model.A), settled), 1)
    ahead = late + turning // 2
    coulomb = np.broadcast_to(np.asarray(linear.friction, float), len(linear.axes))
    if change is not None and np.any(2 / turning * coulomb > change):
        return design
    friction = partial(
        FrictionFeedforward,
        coulomb=coulomb,
        limit=np.inf if limit is None else limit,
        ahead=ahead,
        hold_after=settled + ahead,  # it stands where the tool is to be that far ahead
        turning=turning,
    )
    each = ", ".join(f"{one:.6g}" for one in coulomb)
    line = (
        f"friction  {each} {linear.control_unit} in the direction {ahead} samples ahead, "
        f"reversed in {turning} samples"
    )
    preview = max(design.preview, 1 + ahead)
    return design.replaced(compensation=(friction,), preview=preview, beside=(line,))


def _longest_period(A: np.ndarray, most: int) -> int:
    """Of the modes that overshoot by a tenth or more, up to `most` [samples]; 0 without one."""
    poles = np.linalg.eigvals(A).astype(complex)
    decay = -np.log(np.maximum(np.abs(poles), 1e-300))  # per sample, as the turn; delays end at 0
    turn = np.angle(poles)
    rings = (decay <= RINGS * np.hypot(decay, turn)) & (2 * np.pi <= most * turn)
    return round(float(2 * np.pi / turn[rings].min())) if rings.any() else 0


def set_of(flags: Controlled) -> list[str]:
    """Flags that are set, of those that not every controller reads."""
    return [name for name in SETTINGS if getattr(flags, name) != getattr(Controlled, name)]


def names_controller(flags: Controlled) -> bool:
    """Whether the user names a controller, its weights, or what a usual one alone reads."""
    return bool(flags.controller is not None or given(flags) or set_of(flags))


def seeing_all(flags: Flags, job: Task) -> Flags:
    """The flags; where their preview is the whole path, with as many samples as the run has.

    Every step then sees all that is left of the run, and how it goes on behind its end.
    """
    whole = isinstance(flags.preview, WholePath)
    return replace(flags, preview=job.samples) if whole else flags


def _listed_name(asked: str, machine: Machine) -> str:
    """Name in the catalogue; `cascade` is `gantry-cascade` on a gantry."""
    for name in (asked, *(prefix + asked for prefix in PREFIXES)):
        if name in CONTROLLERS and _needs(name).met_by(machine):
            return name
    if asked in CONSTRAINED:
        raise ValueError(
            f"controller: {asked}, {CONSTRAINED[asked].line}: nothing is tuned of it, run it with "
            "`jcontour simulate`"
        )
    if asked not in CONTROLLERS:
        raise ValueError(
            f"controller: there is none named {asked!r}; "
            f"give one of {', '.join(controllers_for(machine))}"
        )
    raise ValueError(
        f"controller: {asked} needs {_needs(asked).words}; "
        f"{machine.name} takes {machine.usual.controller or f'one of your own, {FILE}'}"
    )
