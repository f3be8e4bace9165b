"""Controllers, one a file: each a plan made from the future, a memory and a step."""

from jcontour.controllers.cascade import Cascade, CascadeGains
from jcontour.controllers.command_shaping import CommandShaped
from jcontour.controllers.compensated import Compensated
from jcontour.controllers.contouring_lq import ContouringLQ, LQWeights, OutputTerminal, RiccatiTerminal
from jcontour.controllers.cross_coupled import ConstantCoupling, CrossCoupled, CrossGains, VariableCoupling
from jcontour.controllers.disturbance_observer import DisturbanceObserver
from jcontour.controllers.extended_state_observers import NLESO, CurrentLESO, DisturbanceRejection, EulerLESO, ExactLESO
from jcontour.controllers.filters import Biquad, Filtered, low_pass, notch
from jcontour.controllers.integral_lqg import IntegralLQG, integral_lq_gains
from jcontour.controllers.motors import OfMotors
from jcontour.controllers.observers import FilterObserver, OffsetFreeObserver, PredictorObserver, kalman_gain, offset_free_gain
from jcontour.controllers.pole_placement import damped_poles, placed_gain
from jcontour.controllers.precompensation import Precompensated
from jcontour.controllers.preview_lq import PreviewLQ
from jcontour.controllers.reduced_observer import ReducedObserver
from jcontour.controllers.scheduled_lq import ScheduledLQ
from jcontour.controllers.shaped import Shaped
from jcontour.controllers.state_feedback import StateFeedback, lq_gain, moving_target, quasi_steady_target
from jcontour.controllers.task_frame import TaskFrame

__all__ = [
    "Biquad",
    "Cascade",
    "CascadeGains",
    "CommandShaped",
    "Compensated",
    "ConstantCoupling",
    "ContouringLQ",
    "CrossCoupled",
    "CrossGains",
    "CurrentLESO",
    "DisturbanceObserver",
    "DisturbanceRejection",
    "EulerLESO",
    "ExactLESO",
    "FilterObserver",
    "Filtered",
    "IntegralLQG",
    "LQWeights",
    "NLESO",
    "OfMotors",
    "OffsetFreeObserver",
    "OutputTerminal",
    "Precompensated",
    "PredictorObserver",
    "PreviewLQ",
    "ReducedObserver",
    "RiccatiTerminal",
    "ScheduledLQ",
    "Shaped",
    "StateFeedback",
    "TaskFrame",
    "VariableCoupling",
    "damped_poles",
    "integral_lq_gains",
    "kalman_gain",
    "low_pass",
    "lq_gain",
    "moving_target",
    "notch",
    "offset_free_gain",
    "placed_gain",
    "quasi_steady_target",
]
