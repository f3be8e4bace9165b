"""Plants by name, for the contract tests and for `jcontour list`.

Those with the name of a machine are for `--plant`; the others are made in Python:
`PLANTS["gantry-hil"].make()`.
"""

from typing import TYPE_CHECKING

from jcontour.app.catalogue import machines
from jcontour.app.catalogue.entries import PlantEntry

if TYPE_CHECKING:
    from jcontour.plant import Plant
    from jcontour.plants.gantry.gantry import Gantry

SAMPLE = 1e-3  # [s] of the thesis's controllers


def _bridgeport() -> "Plant":
    from jcontour.plants.bridgeport import exact_bridgeport

    return exact_bridgeport()


def _bridgeport_encoders() -> "Plant":
    from jcontour.plants.wrappers.encoders import Encoders

    return Encoders(_bridgeport())


def _bridgeport_late() -> "Plant":
    from jcontour.plants.wrappers.delays import Delayed

    return Delayed(_bridgeport(), 1, 2, 2)


def _bridgeport_quantised() -> "Plant":
    from jcontour.plants.bridgeport import ENCODER_RESOLUTION
    from jcontour.plants.wrappers.encoders import Quantised

    return Quantised(_bridgeport_encoders(), ENCODER_RESOLUTION)


def _xy_table() -> "Plant":
    from jcontour.plants.xy_table import FrictionXYTable

    return FrictionXYTable(1e-3)


def _emps() -> "Plant":
    from jcontour.plants.emps import emps_table

    return emps_table()


def _flexible_axis() -> "Plant":
    from jcontour.plants.flexible_axis.axis import FlexibleAxis, thesis_axis

    return FlexibleAxis(thesis_axis(), SAMPLE)


def _smooth_flexible_axis() -> "Plant":
    from jcontour.plants.flexible_axis.axis import SmoothFlexibleAxis, thesis_axis

    return SmoothFlexibleAxis(thesis_axis(), SAMPLE)


def _flexible_axes() -> "Plant":
    from jcontour.app.machines.flexible_axis import biaxial_axes
    from jcontour.plants.flexible_axis.axis import FlexibleAxis

    return FlexibleAxis(biaxial_axes(), SAMPLE)


def _gantry() -> "Gantry":
    from jcontour.plants.gantry.gantry import Gantry
    from jcontour.plants.gantry.parameters import thesis_gantry

    return Gantry(thesis_gantry(), SAMPLE)


def _gantry_with_friction() -> "Plant":
    from jcontour.app.machines.gantry import guide_ways
    from jcontour.plants.gantry.friction_gantry import StickSlipGantry
    from jcontour.plants.gantry.parameters import thesis_gantry

    return StickSlipGantry(thesis_gantry(), guide_ways(), SAMPLE)


def _smooth_gantry_with_friction() -> "Plant":
    from jcontour.app.machines.gantry import guide_ways
    from jcontour.plants.gantry.friction_gantry import SmoothFrictionGantry
    from jcontour.plants.gantry.parameters import thesis_gantry

    return SmoothFrictionGantry(thesis_gantry(), guide_ways(), SAMPLE)


def _gantry_with_hardware() -> "Plant":
    from jcontour.plants.gantry.motor_bench.back_to_back_motors import servo_bench
    from jcontour.plants.gantry.motor_bench.hardware_in_loop import HardwareInLoop

    return HardwareInLoop(_gantry(), servo_bench())


PLANTS = {
    "bridgeport": PlantEntry(
        _bridgeport,
        "X-Y table of a machining centre, 8 states, 0.5 ms (McNab & Tsao)",
        machines.bridgeport,
        stable=False,
    ),
    "bridgeport-encoders": PlantEntry(
        _bridgeport_encoders,
        "bridgeport, only its positions measured",
        machines.bridgeport,
        stable=False,
    ),
    "bridgeport-late": PlantEntry(
        _bridgeport_late,
        "bridgeport under one sample of unmodelled delay",
        machines.bridgeport,
        stable=False,
    ),
    "bridgeport-quantised": PlantEntry(
        _bridgeport_quantised,
        "bridgeport-encoders with counts of 0.8 um",
        machines.bridgeport,
        smooth=False,
        stable=False,
    ),
    "xy-table": PlantEntry(
        _xy_table,
        "X-Y table on lead screws with Coulomb friction, 8 states, 1 ms (Lam)",
        machines.xy_table,
        stable=False,
    ),
    "emps": PlantEntry(
        _emps,
        "X-Y table of two EMPS drives, 4 states, 1 ms, without their dry friction (Janot et al.)",
        machines.emps,
        stable=False,
    ),
    "flexible-axis": PlantEntry(
        _flexible_axis,
        "linear motor, spring and end effector, stick and slip, cogging (Yuan); tuned on its twin",
        machines.flexible_axis,
        smooth=False,
    ),
    "flexible-axis-smooth": PlantEntry(
        _smooth_flexible_axis,
        "smooth twin of flexible-axis: dry friction turns within 1 mm/s, cogging makes it creep",
        machines.flexible_axis,
        still=False,
    ),
    "flexible-axes": PlantEntry(
        _flexible_axes,
        "two different flexible axes at right angles",
        machines.flexible_axes,
        smooth=False,
    ),
    "gantry": PlantEntry(
        _gantry,
        "head on a beam that twists between its two drives (Yuan)",
        machines.gantry,
        stable=False,
    ),
    "gantry-friction": PlantEntry(
        _gantry_with_friction,
        "the same with stick and slip in its three guide ways; tuned on its twin",
        machines.gantry_with_friction,
        smooth=False,
        stable=False,
    ),
    "gantry-friction-smooth": PlantEntry(
        _smooth_gantry_with_friction,
        "smooth twin of gantry-friction: dry friction turns within 1 mm/s",
        machines.gantry_with_friction,
        stable=False,
    ),
    "gantry-hil": PlantEntry(
        _gantry_with_hardware,
        "gantry with a motor bench as its head, one sample late: "
        "its twist grows unless the drives damp it; tuned on the gantry",
        machines.gantry,
        smooth=False,
        stable=False,
    ),
}
