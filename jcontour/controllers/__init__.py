"""Controllers, one a file: each a plan made from the future, a memory and a step."""

from jcontour.controllers.cascade import Cascade, CascadeGains
from jcontour.controllers.contouring_lq import ContouringLQ, LQWeights, OutputTerminal, RiccatiTerminal
from jcontour.controllers.extended_state_observers import NLESO, CurrentLESO, DisturbanceRejection, EulerLESO, ExactLESO
from jcontour.controllers.filters import Biquad, Filtered, low_pass, notch
from jcontour.controllers.observers import FilterObserver, PredictorObserver, kalman_gain
from jcontour.controllers.preview_lq import PreviewLQ

__all__ = [
    "Biquad",
    "Cascade",
    "CascadeGains",
    "ContouringLQ",
    "CurrentLESO",
    "DisturbanceRejection",
    "EulerLESO",
    "ExactLESO",
    "FilterObserver",
    "Filtered",
    "LQWeights",
    "NLESO",
    "OutputTerminal",
    "PredictorObserver",
    "PreviewLQ",
    "RiccatiTerminal",
    "kalman_gain",
    "low_pass",
    "notch",
]
