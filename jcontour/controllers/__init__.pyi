from .contouring.command_shaping import CommandShaped as CommandShaped
from .contouring.cross_coupled import (
    ConstantCoupling as ConstantCoupling,
)
from .contouring.cross_coupled import (
    CrossCoupled as CrossCoupled,
)
from .contouring.cross_coupled import (
    CrossGains as CrossGains,
)
from .contouring.cross_coupled import (
    VariableCoupling as VariableCoupling,
)
from .contouring.polar import Polar as Polar
from .contouring.precompensation import Precompensated as Precompensated
from .contouring.task_frame import TaskFrame as TaskFrame
from .feedback.adaptive_robust import AdaptiveRobust as AdaptiveRobust
from .feedback.admissible import LoopLimits as LoopLimits
from .feedback.admissible import enough_steps as enough_steps
from .feedback.admissible import governed_loop as governed_loop
from .feedback.cascade import Cascade as Cascade
from .feedback.cascade import CascadeGains as CascadeGains
from .feedback.dynamic_surface import DynamicSurface as DynamicSurface
from .feedback.governor import ScalarGovernor as ScalarGovernor
from .feedback.governor import VectorGovernor as VectorGovernor
from .feedback.hinf_feedback import HInfinityFeedback as HInfinityFeedback
from .feedback.hinf_feedback import MixedWeights as MixedWeights
from .feedback.hinf_feedback import mixed_sensitivity as mixed_sensitivity
from .feedback.hinf_synthesis import central_controller as central_controller
from .feedback.hinf_synthesis import least_gamma as least_gamma
from .feedback.integral_lqg import (
    IntegralLQG as IntegralLQG,
)
from .feedback.integral_lqg import (
    integral_lq_gains as integral_lq_gains,
)
from .feedback.pole_placement import damped_poles as damped_poles
from .feedback.pole_placement import placed_gain as placed_gain
from .feedback.predictive_cascade import PredictiveCascade as PredictiveCascade
from .feedback.self_tuning import SelfTuning as SelfTuning
from .feedback.sliding_mode import BoundaryLayer as BoundaryLayer
from .feedback.sliding_mode import SlidingMode as SlidingMode
from .feedback.sliding_mode import SuperTwisting as SuperTwisting
from .feedback.sliding_mode import riccati_surface as riccati_surface
from .feedback.state_feedback import (
    StateFeedback as StateFeedback,
)
from .feedback.state_feedback import (
    lq_gain as lq_gain,
)
from .feedback.state_feedback import (
    moving_target as moving_target,
)
from .feedback.state_feedback import (
    quasi_steady_target as quasi_steady_target,
)
from .feedback.time_delay import TimeDelayControl as TimeDelayControl
from .feedforward.adaptive_zpetc import AdaptiveZeroPhaseTracking as AdaptiveZeroPhaseTracking
from .feedforward.causal_inverse import causal_filter as causal_filter
from .feedforward.friction_feedforward import FrictionFeedforward as FrictionFeedforward
from .feedforward.hinf import hinf_optimum as hinf_optimum
from .feedforward.inverse_feedforward import InverseFeedforward as InverseFeedforward
from .feedforward.model_following import ModelFollowing as ModelFollowing
from .feedforward.model_following import optimal_feedforward as optimal_feedforward
from .feedforward.zpetc import (
    ZeroPhaseTracking as ZeroPhaseTracking,
)
from .feedforward.zpetc import (
    zero_phase_filter as zero_phase_filter,
)
from .learning.cartesian import CartesianControl as CartesianControl
from .learning.laps import Learned as Learned
from .learning.laps import laps_of as laps_of
from .learning.laps import learn as learn
from .learning.norm_optimal import norm_optimal as norm_optimal
from .learning.p_type import PType as PType
from .learning.predictive_repetitive import PredictiveRepetitive as PredictiveRepetitive
from .learning.repetitive import Repetitive as Repetitive
from .learning.repetitive import RepetitiveFilter as RepetitiveFilter
from .learning.runout import Canceller as Canceller
from .learning.runout import RunoutCancelled as RunoutCancelled
from .lq.blockwise_lq import BlockwiseLQ as BlockwiseLQ
from .lq.contouring_lq import (
    ContouringLQ as ContouringLQ,
)
from .lq.contouring_lq import (
    LQWeights as LQWeights,
)
from .lq.contouring_lq import (
    OutputTerminal as OutputTerminal,
)
from .lq.contouring_lq import (
    RiccatiTerminal as RiccatiTerminal,
)
from .lq.cross_coupled_lq import CrossCoupledLQ as CrossCoupledLQ
from .lq.preview_lq import PreviewLQ as PreviewLQ
from .lq.scheduled_lq import ScheduledLQ as ScheduledLQ
from .lq.zero_terminal import ZeroTerminal as ZeroTerminal
from .observers.disturbance_observer import DisturbanceObserver as DisturbanceObserver
from .observers.extended_state_observers import (
    NLESO as NLESO,
)
from .observers.extended_state_observers import (
    CurrentLESO as CurrentLESO,
)
from .observers.extended_state_observers import (
    DisturbanceRejection as DisturbanceRejection,
)
from .observers.extended_state_observers import (
    EulerLESO as EulerLESO,
)
from .observers.extended_state_observers import (
    ExactLESO as ExactLESO,
)
from .observers.kalman import (
    FilterObserver as FilterObserver,
)
from .observers.kalman import (
    OffsetFreeObserver as OffsetFreeObserver,
)
from .observers.kalman import (
    PredictorObserver as PredictorObserver,
)
from .observers.kalman import (
    kalman_gain as kalman_gain,
)
from .observers.kalman import (
    offset_free_gain as offset_free_gain,
)
from .observers.reduced_observer import ReducedObserver as ReducedObserver
from .synchronisation.adaptive import (
    AdaptiveSynchronisation as AdaptiveSynchronisation,
)
from .synchronisation.adaptive import (
    SynchronisedGains as SynchronisedGains,
)
from .synchronisation.master_slave import MasterSlave as MasterSlave
from .wrappers.backlash_compensation import BacklashCompensation as BacklashCompensation
from .wrappers.compensated import Compensated as Compensated
from .wrappers.filters import (
    Biquad as Biquad,
)
from .wrappers.filters import (
    Filtered as Filtered,
)
from .wrappers.filters import (
    low_pass as low_pass,
)
from .wrappers.filters import (
    notch as notch,
)
from .wrappers.motor_kinematics import OfMotors as OfMotors
from .wrappers.shaped import Shaped as Shaped
from .wrappers.speed_by_difference import SpeedByDifference as SpeedByDifference
