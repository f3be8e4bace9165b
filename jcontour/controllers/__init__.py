"""Controllers, one a file: each a plan made from the future, a memory and a step."""

from jcontour.controllers.contouring.command_shaping import CommandShaped
from jcontour.controllers.contouring.cross_coupled import (
    ConstantCoupling,
    CrossCoupled,
    CrossGains,
    VariableCoupling,
)
from jcontour.controllers.contouring.precompensation import Precompensated
from jcontour.controllers.contouring.task_frame import TaskFrame
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.integral_lqg import IntegralLQG, integral_lq_gains
from jcontour.controllers.feedback.pole_placement import damped_poles, placed_gain
from jcontour.controllers.feedback.state_feedback import (
    StateFeedback,
    lq_gain,
    moving_target,
    quasi_steady_target,
)
from jcontour.controllers.feedforward.adaptive_synchronisation import (
    AdaptiveSynchronisation,
    SynchronisedGains,
)
from jcontour.controllers.feedforward.adaptive_zpetc import AdaptiveZeroPhaseTracking
from jcontour.controllers.feedforward.inverse_feedforward import InverseFeedforward
from jcontour.controllers.feedforward.zpetc import ZeroPhaseTracking, zero_phase_filter
from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    OutputTerminal,
    RiccatiTerminal,
)
from jcontour.controllers.lq.preview_lq import PreviewLQ
from jcontour.controllers.lq.scheduled_lq import ScheduledLQ
from jcontour.controllers.observers.disturbance_observer import DisturbanceObserver
from jcontour.controllers.observers.extended_state_observers import (
    NLESO,
    CurrentLESO,
    DisturbanceRejection,
    EulerLESO,
    ExactLESO,
)
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    PredictorObserver,
    kalman_gain,
    offset_free_gain,
)
from jcontour.controllers.observers.reduced_observer import ReducedObserver
from jcontour.controllers.wrappers.compensated import Compensated
from jcontour.controllers.wrappers.filters import Biquad, Filtered, low_pass, notch
from jcontour.controllers.wrappers.motor_kinematics import OfMotors
from jcontour.controllers.wrappers.shaped import Shaped
from jcontour.controllers.wrappers.speed_by_difference import SpeedByDifference

__all__ = [
    "AdaptiveSynchronisation",
    "AdaptiveZeroPhaseTracking",
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
    "InverseFeedforward",
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
    "SpeedByDifference",
    "StateFeedback",
    "SynchronisedGains",
    "TaskFrame",
    "VariableCoupling",
    "ZeroPhaseTracking",
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
    "zero_phase_filter",
]
