"""Machines by name, and what their controllers need of a machine."""

from collections.abc import Callable

from experiments.catalogue.entries import Need
from experiments.machines.flexible_axis import FlexibleMachine, biaxial_machine, thesis_machine
from experiments.machines.gantry import GantryMachine, friction_gantry_machine, gantry_machine
from experiments.machines.linear import LinearMachine, bridgeport_machine
from experiments.machines.machine import Machine
from experiments.machines.xy_table import xy_table_machine

MACHINES: dict[str, Callable[[], Machine]] = {  # each under the name of one of the plants
    "bridgeport": bridgeport_machine,
    "xy-table": xy_table_machine,
    "flexible-axis": thesis_machine,
    "flexible-axes": biaxial_machine,
    "gantry": gantry_machine,
    "gantry-friction": friction_gantry_machine,
}


NEEDS = {  # of the controllers on each
    "bridgeport": Need(
        "a machine given by A, B, C", lambda machine: isinstance(machine, LinearMachine)
    ),
    "flexible-axis": Need("a flexible axis", lambda machine: isinstance(machine, FlexibleMachine)),
    "flexible-axes": Need(
        "two flexible axes or more, for a contour",
        lambda machine: isinstance(machine, FlexibleMachine) and len(machine.axes) > 1,
    ),
    "gantry": Need("a gantry", lambda machine: isinstance(machine, GantryMachine)),
    "gantry-friction": Need(
        "a gantry with dry friction",
        lambda machine: isinstance(machine, GantryMachine) and machine.friction is not None,
    ),
}
