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
from jcontour.controllers.feedback.self_tuning import SelfTuning
from jcontour.controllers.feedback.state_feedback import (
    StateFeedback,
    lq_gain,
    moving_target,
    quasi_steady_target,
)
from jcontour.controllers.feedback.time_delay import TimeDelayControl
from jcontour.controllers.feedforward.adaptive_zpetc import AdaptiveZeroPhaseTracking
from jcontour.controllers.feedforward.friction_feedforward import FrictionFeedforward
from jcontour.controllers.feedforward.inverse_feedforward import InverseFeedforward
from jcontour.controllers.feedforward.zpetc import ZeroPhaseTracking, zero_phase_filter
from jcontour.controllers.learning.cartesian import CartesianControl
from jcontour.controllers.learning.laps import Learned, laps_of, learn
from jcontour.controllers.learning.norm_optimal import norm_optimal
from jcontour.controllers.learning.p_type import PType
from jcontour.controllers.learning.repetitive import Repetitive, RepetitiveFilter
from jcontour.controllers.learning.runout import Canceller, RunoutCancelled
from jcontour.controllers.lq.blockwise_lq import BlockwiseLQ
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
from jcontour.controllers.synchronisation.adaptive import (
    AdaptiveSynchronisation,
    SynchronisedGains,
)
from jcontour.controllers.wrappers.compensated import Compensated
from jcontour.controllers.wrappers.filters import Biquad, Filtered, low_pass, notch
from jcontour.controllers.wrappers.motor_kinematics import OfMotors
from jcontour.controllers.wrappers.shaped import Shaped
from jcontour.controllers.wrappers.speed_by_difference import SpeedByDifference

__all__ = [
    "AdaptiveSynchronisation",
    "AdaptiveZeroPhaseTracking",
    "Biquad",
    "BlockwiseLQ",
    "Canceller",
    "CartesianControl",
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
    "FrictionFeedforward",
    "IntegralLQG",
    "InverseFeedforward",
    "LQWeights",
    "Learned",
    "NLESO",
    "OfMotors",
    "OffsetFreeObserver",
    "OutputTerminal",
    "PType",
    "Precompensated",
    "PredictorObserver",
    "PreviewLQ",
    "ReducedObserver",
    "Repetitive",
    "RepetitiveFilter",
    "RiccatiTerminal",
    "RunoutCancelled",
    "ScheduledLQ",
    "SelfTuning",
    "Shaped",
    "SpeedByDifference",
    "StateFeedback",
    "SynchronisedGains",
    "TaskFrame",
    "TimeDelayControl",
    "VariableCoupling",
    "ZeroPhaseTracking",
    "damped_poles",
    "integral_lq_gains",
    "kalman_gain",
    "laps_of",
    "learn",
    "low_pass",
    "lq_gain",
    "moving_target",
    "norm_optimal",
    "notch",
    "offset_free_gain",
    "placed_gain",
    "quasi_steady_target",
    "zero_phase_filter",
]
