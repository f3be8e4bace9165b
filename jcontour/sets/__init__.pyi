from .invariant_polytopes import control_invariant as control_invariant
from .least_peaks import least_peak as least_peak
from .responses import DisturbedModel as DisturbedModel
from .responses import Signal as Signal
from .responses import VaryingModel as VaryingModel
from .responses import brought_to_rest_along as brought_to_rest_along
from .tolerance_certificates import least_tolerance_of_any as least_tolerance_of_any
