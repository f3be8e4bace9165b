"""Machines by name."""

from jcontour.app.catalogue.entries import Entry

MACHINES = {
    "bridgeport": Entry(
        "X-Y table of a machining centre, 8 states, 0.5 ms (McNab & Tsao)",
        "jcontour.app.machines.linear:bridgeport_machine",
    ),
    "xy-table": Entry(
        "X-Y table on lead screws with Coulomb friction, 8 states, 1 ms (Lam)",
        "jcontour.app.machines.xy_table:xy_table_machine",
    ),
    "emps": Entry(
        "X-Y table of two EMPS drives, 4 states, 1 ms, without their dry friction (Janot et al.)",
        "jcontour.app.machines.emps:emps_machine",
    ),
    "flexible-axis": Entry(
        "linear motor, spring and end effector, stick and slip, cogging (Yuan); tuned on its twin",
        "jcontour.app.machines.flexible_axis:thesis_machine",
    ),
    "flexible-axes": Entry(
        "two different flexible axes at right angles",
        "jcontour.app.machines.flexible_axis:biaxial_machine",
    ),
    "gantry": Entry(
        "head on a beam that twists between its two drives (Yuan)",
        "jcontour.app.machines.gantry:gantry_machine",
    ),
    "gantry-friction": Entry(
        "the same with stick and slip in its three guide ways; tuned on its twin",
        "jcontour.app.machines.gantry:friction_gantry_machine",
    ),
}
