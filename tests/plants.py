"""Plants of the contract tests by name."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

from jcontour.app.catalogue.choices import controllers_for, machine_named
from jcontour.app.catalogue.entries import MACHINES
from jcontour.app.machines.flexible_axis import biaxial_axes
from jcontour.app.machines.gantry import guide_ways
from jcontour.app.machines.machine import Machine
from jcontour.plant import Plant
from jcontour.plants.actuation import Delayed
from jcontour.plants.emps import emps_table
from jcontour.plants.encoders import Encoders, Quantised
from jcontour.plants.flexible_axis.axis import FlexibleAxis, SmoothFlexibleAxis, thesis_axis
from jcontour.plants.gantry.friction_gantry import SmoothFrictionGantry, StickSlipGantry
from jcontour.plants.gantry.gantry import Gantry, thesis_gantry
from jcontour.plants.linear_machines import ENCODER_RESOLUTION, exact_bridgeport
from jcontour.plants.xy_table import FrictionXYTable

SAMPLE = 1e-3  # [s] of the thesis's controllers


@cache
def first_machine(controller: str) -> str:
    """Name of the first machine of the catalogue that a controller suits."""
    return next(name for name in MACHINES if controller in controllers_for(machine_named(name)))


class Sample(NamedTuple):
    """A plant; the catalogue's machine that it is one of; whether it stays at rest by itself."""

    make: Callable[[], Plant]
    of: str
    still: bool = True

    def machine(self) -> Machine:
        return MACHINES[self.of]()


def ways():
    return thesis_gantry(), guide_ways(), SAMPLE


PLANTS = {
    "bridgeport": Sample(exact_bridgeport, "bridgeport"),
    "bridgeport-encoders": Sample(lambda: Encoders(exact_bridgeport()), "bridgeport"),
    "bridgeport-late": Sample(lambda: Delayed(exact_bridgeport(), 1, 2, 2), "bridgeport"),
    "bridgeport-quantised": Sample(
        lambda: Quantised(Encoders(exact_bridgeport()), ENCODER_RESOLUTION), "bridgeport"
    ),
    "xy-table": Sample(lambda: FrictionXYTable(1e-3), "xy-table"),
    "emps": Sample(emps_table, "emps"),
    "flexible-axis": Sample(lambda: FlexibleAxis(thesis_axis(), SAMPLE), "flexible-axis"),
    "flexible-axis-smooth": Sample(  # its cogging makes it creep
        lambda: SmoothFlexibleAxis(thesis_axis(), SAMPLE), "flexible-axis", still=False
    ),
    "flexible-axes": Sample(lambda: FlexibleAxis(biaxial_axes(), SAMPLE), "flexible-axes"),
    "gantry": Sample(lambda: Gantry(thesis_gantry(), SAMPLE), "gantry"),
    "gantry-friction": Sample(lambda: StickSlipGantry(*ways()), "gantry-friction"),
    "gantry-friction-smooth": Sample(lambda: SmoothFrictionGantry(*ways()), "gantry-friction"),
}
