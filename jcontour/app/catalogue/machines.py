"""Machines by name, and the kinds of machine that controllers are for.

Every function imports what it needs when it is called: names are answered without.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from jcontour.app.catalogue.entries import Requirement

if TYPE_CHECKING:
    from jcontour.app.machines.gantry import GantryMachine
    from jcontour.app.machines.machine import Machine


def bridgeport() -> "Machine":
    """The X-Y table of McNab & Tsao."""
    from jcontour.app.machines.linear import bridgeport_machine

    return bridgeport_machine()


def xy_table() -> "Machine":
    """Lam's X-Y table."""
    from jcontour.app.machines.xy_table import xy_table_machine

    return xy_table_machine()


def emps() -> "Machine":
    """Two EMPS drives, a public benchmark of identification, at right angles."""
    from jcontour.app.machines.emps import emps_machine

    return emps_machine()


def flexible_axis() -> "Machine":
    """The axis of Yuan's thesis."""
    from jcontour.app.machines.flexible_axis import thesis_machine

    return thesis_machine()


def flexible_axes() -> "Machine":
    """Two flexible axes at right angles."""
    from jcontour.app.machines.flexible_axis import biaxial_machine

    return biaxial_machine()


def gantry() -> "Machine":
    """Yuan's laser cutter."""
    from jcontour.app.machines.gantry import gantry_machine

    return gantry_machine()


def gantry_with_friction() -> "Machine":
    """The same with dry friction in its guide ways."""
    from jcontour.app.machines.gantry import friction_gantry_machine

    return friction_gantry_machine()


MACHINES: dict[str, Callable[[], "Machine"]] = {  # each under the name of one of the plants
    "bridgeport": bridgeport,
    "xy-table": xy_table,
    "emps": emps,
    "flexible-axis": flexible_axis,
    "flexible-axes": flexible_axes,
    "gantry": gantry,
    "gantry-friction": gantry_with_friction,
}


def _is_linear(machine: "Machine") -> bool:
    from jcontour.app.machines.linear import LinearMachine

    return machine.form(LinearMachine) is not None


def _states_limits(machine: "Machine") -> bool:
    return _is_linear(machine) and any(limit is not None for limit in machine.limits)


def _is_flexible(machine: "Machine") -> bool:
    from jcontour.app.machines.flexible_axis import FlexibleMachine

    return machine.form(FlexibleMachine) is not None


def _has_flexible_axes(machine: "Machine") -> bool:
    return _is_flexible(machine) and len(machine.axes) > 1


def _gantry(machine: "Machine") -> "GantryMachine | None":
    from jcontour.app.machines.gantry import GantryMachine

    return machine.form(GantryMachine)


def _is_gantry(machine: "Machine") -> bool:
    return _gantry(machine) is not None


def _has_dry_friction(machine: "Machine") -> bool:
    gantry = _gantry(machine)
    return gantry is not None and gantry.friction is not None


def _has_no_dry_friction(machine: "Machine") -> bool:
    return _is_gantry(machine) and not _has_dry_friction(machine)


LINEAR = Requirement("a machine given by A, B, C", _is_linear)
LIMITED = Requirement("a machine given by A, B, C that states limits", _states_limits)
FLEXIBLE_AXIS = Requirement("a flexible axis", _is_flexible)
FLEXIBLE_AXES = Requirement("two flexible axes or more, for a contour", _has_flexible_axes)
GANTRY = Requirement("a gantry", _is_gantry)
GANTRY_WITH_FRICTION = Requirement("a gantry with dry friction", _has_dry_friction)
GANTRY_WITHOUT_FRICTION = Requirement("a gantry without dry friction", _has_no_dry_friction)
