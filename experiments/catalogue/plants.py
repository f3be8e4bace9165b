"""Plants by name, for the contract tests and for `jcontour list`."""

from experiments.catalogue.entries import Entry
from experiments.machines.flexible_axis import biaxial_axes
from experiments.machines.gantry import guide_ways
from jcontour.plants.bridgeport import exact_bridgeport
from jcontour.plants.flexible_axis.axis import FlexibleAxis, SmoothFlexibleAxis, thesis_axis
from jcontour.plants.gantry.back_to_back_motors import servo_bench
from jcontour.plants.gantry.friction_gantry import SmoothFrictionGantry, StickSlipGantry
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.hardware_in_loop import HardwareInLoop
from jcontour.plants.gantry.parameters import thesis_gantry
from jcontour.plants.wrappers.delays import Delayed
from jcontour.plants.wrappers.encoders import Encoders, Quantised
from jcontour.plants.xy_table import FrictionXYTable


def _late(samples: int):
    return Delayed(exact_bridgeport(), samples, 2, 2)


PLANTS = {
    "bridgeport": Entry(
        exact_bridgeport,
        "X-Y table of a machining centre, 8 states, 0.5 ms (McNab & Tsao)",
        stable=False,
    ),
    "bridgeport-encoders": Entry(
        lambda: Encoders(exact_bridgeport()), "the same, only its positions measured", stable=False
    ),
    "bridgeport-late": Entry(
        lambda: _late(1), "the same under one sample of unmodelled delay", stable=False
    ),
    "bridgeport-quantised": Entry(
        lambda: Quantised(Encoders(exact_bridgeport()), 0.8e-6),
        "the same with encoder counts of 0.8 um",
        smooth=False,
        stable=False,
    ),
    "xy-table": Entry(
        lambda: FrictionXYTable(1e-3),
        "X-Y table on lead screws with Coulomb friction, 8 states, 1 ms (Lam)",
        stable=False,
        on="xy-table",
    ),
    "flexible-axis": Entry(
        lambda: FlexibleAxis(thesis_axis(), 1e-3),
        "linear motor, spring and end effector, stick and slip, cogging (Yuan); tuned on its twin",
        smooth=False,
        on="flexible-axis",
    ),
    "flexible-axis-smooth": Entry(
        lambda: SmoothFlexibleAxis(thesis_axis(), 1e-3),
        "its smooth twin: dry friction turns within 1 mm/s, so that cogging makes it creep",
        still=False,
        on="flexible-axis",
    ),
    "flexible-axes": Entry(
        lambda: FlexibleAxis(biaxial_axes(), 1e-3),
        "two different flexible axes at right angles",
        smooth=False,
        on="flexible-axes",
    ),
    "gantry": Entry(
        lambda: Gantry(thesis_gantry(), 1e-3),
        "head on a beam that twists between its two drives (Yuan)",
        stable=False,
        on="gantry",
    ),
    "gantry-friction": Entry(
        lambda: StickSlipGantry(thesis_gantry(), guide_ways(), 1e-3),
        "the same with stick and slip in its three guide ways; tuned on its twin",
        smooth=False,
        stable=False,
        on="gantry-friction",
    ),
    "gantry-friction-smooth": Entry(
        lambda: SmoothFrictionGantry(thesis_gantry(), guide_ways(), 1e-3),
        "its smooth twin: dry friction turns within 1 mm/s",
        stable=False,
        on="gantry-friction",
    ),
    "gantry-hil": Entry(
        lambda: HardwareInLoop(Gantry(thesis_gantry(), 1e-3), servo_bench()),
        "the same with a motor bench as its head, one sample late: its twist grows unless the drives damp it; tuned on the gantry",
        smooth=False,
        stable=False,
        on="gantry",
    ),
}
