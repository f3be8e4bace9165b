"""The linear machines of the catalogue: tables of two papers, and a public benchmark."""

import numpy as np

from jcontour.app.machines.linear import USUAL, LinearMachine
from jcontour.app.machines.machine import Hosted, MachineLimits
from jcontour.app.machines.uncertainty import Uncertainty
from jcontour.plants.linear_machines import ENCODER_RESOLUTION, exact_bridgeport

SAMPLE = 1e-3  # [s] at which the X-Y table is looked at
PERIOD = 4e-3  # [s] of Lam's controllers
# of machines whose motors do not turn a corner at full feed
SMOOTH = USUAL._replace(
    training=("cam", "circle", "ellipse"), held_out=("bracket", "lemniscate"), front=("ellipse",)
)


def bridgeport_machine() -> LinearMachine:
    """McNab & Tsao's X-Y table, its integrators exact; no limits or uncertainty are stated there.

    Weights are the best of those found by hand: Table 1, case II.
    """
    noise = 0.1  # control units: about what an input gain 10 % off does
    return LinearMachine(
        "bridgeport",
        exact_bridgeport(),
        ("X", "Y"),
        "control unit",
        MachineLimits(control=np.full(2, 10.0)),  # read as volts: analogue drives take +-10 V
        Uncertainty(0.1, 2),
        known_delay=0,
        encoder_resolution=ENCODER_RESOLUTION,
        control_noise=noise,
        # the filter estimates no load
        published={"alpha": 1.2, "beta": 20.0, "rho": 2e-9, "control_noise": noise, "drift": 1e-6},
    )


def xy_table_machine() -> LinearMachine:
    """Lam's table modelled without friction; a controller on the host meets it with friction."""
    from jcontour.plants.xy_table import xy_table

    current = 0.5  # [A] section 5
    return LinearMachine(
        "xy-table",
        xy_table(SAMPLE),
        ("X", "Y"),
        "A",
        MachineLimits(control=np.full(2, current)),
        # of the torque constants, as in the mismatched machine of `reproduce lam`
        Uncertainty(gain=0.1, delay=0),
        known_delay=0,
        encoder_resolution=1e-6,  # [m] not printed, the paper feeds the state: usual for a scale
        control_noise=0.01 * current,
        with_friction=hosted,
        contours=SMOOTH,
    )


def hosted() -> Hosted:
    """The X-Y table with friction at 1 ms, and its model at the controller's period."""
    from jcontour.plants.xy_table import FrictionXYTable, xy_table

    return Hosted(FrictionXYTable(SAMPLE), xy_table(PERIOD), round(PERIOD / SAMPLE))


def emps_machine() -> LinearMachine:
    """The EMPS drive, twice at right angles, without its dry friction, which is to be rejected."""
    from jcontour.plants.emps import LARGEST_VOLTAGE, RESOLUTION, emps_table

    return LinearMachine(
        "emps",
        emps_table(),
        ("X", "Y"),
        "V",
        MachineLimits(control=np.full(2, LARGEST_VOLTAGE)),
        # not published: a usual tolerance of a drive; its controller runs at 1 kHz beside it
        Uncertainty(gain=0.05, delay=1),
        known_delay=0,
        encoder_resolution=RESOLUTION,
        control_noise=0.05 * LARGEST_VOLTAGE,
        contours=SMOOTH,
    )
