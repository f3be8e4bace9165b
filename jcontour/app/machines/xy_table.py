"""Lam's X-Y table as a machine of the commands."""

import numpy as np

from jcontour.app.machines.linear import USUAL, LinearMachine
from jcontour.app.machines.machine import Hosted, MachineLimits, whole_samples
from jcontour.plants.xy_table import FrictionXYTable, xy_table

SAMPLE = 1e-3  # [s] at which the machine is looked at
# its motors do not turn a corner at full feed
CONTOURS = USUAL._replace(
    training=("cam", "circle", "ellipse"), held_out=("bracket", "lemniscate"), front=("ellipse",)
)
PERIOD = 4e-3  # [s] of Lam's controllers
LARGEST_CURRENT = 0.5  # [A] section 5
MISMATCH = 0.1  # of the torque constants, as in the mismatched machine of `reproduce lam`
RESOLUTION = 1e-6  # [m] not printed, the paper feeds the state: usual for a linear scale


def xy_table_machine() -> LinearMachine:
    """The table modelled without friction; a controller on the host meets it with friction."""
    return LinearMachine(
        "xy-table",
        xy_table(SAMPLE),
        ("X", "Y"),
        "A",
        MachineLimits(control=np.full(2, LARGEST_CURRENT)),
        known_delay=0,
        gain=MISMATCH,
        delay=0,
        encoder_resolution=RESOLUTION,
        control_noise=0.01 * LARGEST_CURRENT,
        with_friction=hosted,
        contours=CONTOURS,
    )


def hosted(period: float | None) -> Hosted:
    """The table with friction at 1 ms, and its model at the controller's period.

    Raises:
        ValueError: the period is not a whole number of samples.
    """
    period = PERIOD if period is None else period
    every = whole_samples(period, SAMPLE)
    return Hosted(FrictionXYTable(SAMPLE), xy_table(period), every)
