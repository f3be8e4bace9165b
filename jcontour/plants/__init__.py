"""Machines, one a file, and what stands between a controller and an ideal machine."""

from jcontour.plants.actuation import Disturbed, Gained, Saturated
from jcontour.plants.arms import ThreeLink, TwoLinkArm, manipulator_path
from jcontour.plants.delays import Delayed
from jcontour.plants.encoders import CountingEncoders, Encoders, Quantised, Sensed
from jcontour.plants.flexible_axis.axis import (
    FlexibleAxis,
    SmoothFlexibleAxis,
    euler_model,
    thesis_axis,
    zoh_model,
)
from jcontour.plants.flexible_axis.cantilever import Beam, beam_modes, cantilever, thesis_beam
from jcontour.plants.gantry.friction_gantry import SmoothFrictionGantry, StickSlipGantry
from jcontour.plants.gantry.gantry import Gantry, GantryParameters, thesis_gantry
from jcontour.plants.gantry.linear_models import MotorEncoders
from jcontour.plants.linear_machines import (
    bridgeport,
    exact_bridgeport,
    linear_motor_drive,
    servo_axes,
)
from jcontour.plants.xy_table import DriveParameters, FrictionXYTable, xy_table

__all__ = [
    "Beam",
    "CountingEncoders",
    "Delayed",
    "Disturbed",
    "DriveParameters",
    "Encoders",
    "FlexibleAxis",
    "FrictionXYTable",
    "Gained",
    "Gantry",
    "GantryParameters",
    "MotorEncoders",
    "Quantised",
    "Saturated",
    "Sensed",
    "SmoothFlexibleAxis",
    "SmoothFrictionGantry",
    "StickSlipGantry",
    "ThreeLink",
    "TwoLinkArm",
    "beam_modes",
    "bridgeport",
    "cantilever",
    "euler_model",
    "exact_bridgeport",
    "linear_motor_drive",
    "manipulator_path",
    "servo_axes",
    "thesis_axis",
    "thesis_beam",
    "thesis_gantry",
    "xy_table",
    "zoh_model",
]
