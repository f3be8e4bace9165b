"""The EMPS drive: a prismatic axis on a ball screw, a public benchmark of identification.

Janot, Gautier & Brunot, "Data set and reference models of EMPS", Workshop on Nonlinear System
Identification Benchmarks, 2019:

    M q'' = g u - F_v q' - F_c sign(q') - offset
    u = K_v (K_p (q_r - q) - q'),  |u| <= 10 V

with the voltage u of the drive and its gain g. All numbers are the publication's.
"""

import numpy as np

from jcontour.linear.continuous_axes import ContinuousAxis, force_axis, sampled_machine
from jcontour.linear.plant import LinearPlant

MASS = 95.1089  # M [kg]
VISCOUS = 203.5034  # F_v [N s/m]
COULOMB = 20.3935  # F_c [N]
OFFSET = -3.1648  # [N]
DRIVE_GAIN = 35.15  # g [N/V]
POSITION_GAIN = 160.18  # K_p [1/s]
SPEED_GAIN = 243.45  # K_v [V s/m]
LARGEST_VOLTAGE = 10.0  # [V]
SAMPLE_PERIOD = 1e-3  # [s]
RESOLUTION = 0.05e-6  # [m] per count


def emps_axis() -> ContinuousAxis:
    """The axis without its dry friction: g / (M s^2 + F_v s), from volts to metres."""
    return force_axis(DRIVE_GAIN, MASS, VISCOUS)


def emps_table() -> LinearPlant:
    """An X-Y table of two such drives, without their dry friction.

    The benchmark has one axis; two at right angles make it a machine that can follow a contour.

    >>> table = emps_table()
    >>> table.states, table.inputs, table.axes, table.dt
    (4, 2, 2, 0.001)
    """
    plant, _ = sampled_machine([emps_axis(), emps_axis()], SAMPLE_PERIOD)
    return LinearPlant(*(np.asarray(one) for one in (plant.A, plant.B, plant.C)), SAMPLE_PERIOD)
