"""Controllers, one a file: each a plan made from the future, a memory and a step."""

from jcontour.controllers.cascade import Cascade, CascadeGains, Sensors
from jcontour.controllers.contouring_lq import ContouringLQ, LQWeights, OutputTerminal, RiccatiTerminal
from jcontour.controllers.filters import Biquad, Filtered, low_pass, notch
from jcontour.controllers.observers import FilterObserver, PredictorObserver, kalman_gain
from jcontour.controllers.preview_lq import PreviewLQ

__all__ = [
    "Biquad",
    "Cascade",
    "CascadeGains",
    "ContouringLQ",
    "FilterObserver",
    "Filtered",
    "LQWeights",
    "OutputTerminal",
    "PredictorObserver",
    "PreviewLQ",
    "RiccatiTerminal",
    "Sensors",
    "kalman_gain",
    "low_pass",
    "notch",
]
