"""Controllers, one a file: each a plan made from the future, a memory and a step."""

from jcontour.controllers.cascade import Cascade, CascadeGains
from jcontour.controllers.command_shaping import CommandShaped
from jcontour.controllers.contouring_lq import ContouringLQ, LQWeights, OutputTerminal, RiccatiTerminal
from jcontour.controllers.cross_coupled import ConstantCoupling, CrossCoupled, CrossGains, VariableCoupling
from jcontour.controllers.extended_state_observers import NLESO, CurrentLESO, DisturbanceRejection, EulerLESO, ExactLESO
from jcontour.controllers.filters import Biquad, Filtered, low_pass, notch
from jcontour.controllers.observers import FilterObserver, PredictorObserver, kalman_gain
from jcontour.controllers.precompensation import Precompensated
from jcontour.controllers.preview_lq import PreviewLQ
from jcontour.controllers.task_frame import TaskFrame

__all__ = [
    "NLESO",
    "Biquad",
    "Cascade",
    "CascadeGains",
    "CommandShaped",
    "ConstantCoupling",
    "ContouringLQ",
    "CrossCoupled",
    "CrossGains",
    "CurrentLESO",
    "DisturbanceRejection",
    "EulerLESO",
    "ExactLESO",
    "FilterObserver",
    "Filtered",
    "LQWeights",
    "OutputTerminal",
    "Precompensated",
    "PredictorObserver",
    "PreviewLQ",
    "RiccatiTerminal",
    "TaskFrame",
    "VariableCoupling",
    "kalman_gain",
    "low_pass",
    "notch",
]
