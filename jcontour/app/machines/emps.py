"""The EMPS drive, twice at right angles, as a machine of the commands."""

import numpy as np

from jcontour.app.machines.linear import USUAL, LinearMachine
from jcontour.app.machines.machine import MachineLimits
from jcontour.plants.emps import LARGEST_VOLTAGE, RESOLUTION, emps_table

# 95 kg and 10 V do not turn a corner at full feed
CONTOURS = USUAL._replace(
    training=("cam", "circle", "ellipse"), held_out=("bracket", "lemniscate"), front=("ellipse",)
)
MISMATCH = 0.05  # of the drive's gain; not published: a usual tolerance of a drive
LATE = 1  # sample; not published: its controller runs at 1 kHz beside the drive


def emps_machine() -> LinearMachine:
    """The benchmark's drive without its dry friction, which a controller has to reject."""
    return LinearMachine(
        "emps",
        emps_table(),
        ("X", "Y"),
        "V",
        MachineLimits(control=np.full(2, LARGEST_VOLTAGE)),
        known_delay=0,
        gain=MISMATCH,
        delay=LATE,
        encoder_resolution=RESOLUTION,
        control_noise=0.05 * LARGEST_VOLTAGE,
        contours=CONTOURS,
    )
