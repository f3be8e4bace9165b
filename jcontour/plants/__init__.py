"""Machines, one a file, and what stands between a controller and an ideal machine."""

from jcontour.plants.bridgeport import bridgeport, exact_bridgeport
from jcontour.plants.flexible_axis.axis import FlexibleAxis, SmoothFlexibleAxis, thesis_axis
from jcontour.plants.flexible_axis.cantilever import Beam, beam_modes, cantilever, thesis_beam
from jcontour.plants.flexible_axis.linear_motor import DrivenAxis, LinearMotor, thesis_motor
from jcontour.plants.flexible_axis.models import euler_model, zoh_model
from jcontour.plants.gantry.friction_gantry import SmoothFrictionGantry, StickSlipGantry
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.motor_coordinates import MotorEncoders
from jcontour.plants.gantry.parameters import GantryParameters, thesis_gantry
from jcontour.plants.gantry.rigid_gantry import RigidGantry
from jcontour.plants.linear_motor_drive import linear_motor_drive
from jcontour.plants.servo_axes import servo_axes
from jcontour.plants.three_link import ThreeLink, manipulator_path, three_servos
from jcontour.plants.two_link import TwoLinkArm
from jcontour.plants.wrappers.delays import Delayed, LateSensors
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.plants.wrappers.encoders import CountingEncoders, Encoders, Quantised, Sensed
from jcontour.plants.wrappers.gains import Gained
from jcontour.plants.wrappers.saturation import Saturated
from jcontour.plants.xy_table import DriveParameters, FrictionXYTable, xy_table

__all__ = [
    "Beam",
    "CountingEncoders",
    "Delayed",
    "Disturbed",
    "DriveParameters",
    "DrivenAxis",
    "Encoders",
    "FlexibleAxis",
    "FrictionXYTable",
    "Gained",
    "Gantry",
    "GantryParameters",
    "LateSensors",
    "LinearMotor",
    "MotorEncoders",
    "Quantised",
    "RigidGantry",
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
    "thesis_motor",
    "three_servos",
    "xy_table",
    "zoh_model",
]
