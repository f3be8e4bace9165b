from .certificates import Certificate as Certificate
from .certificates import certificate as certificate
from .disturbed_loop import Box as Box
from .disturbed_loop import DisturbedLoop as DisturbedLoop
from .disturbed_loop import UnstableLoop as UnstableLoop
from .disturbed_loop import disturbed_loop as disturbed_loop
from .peak_bounds import PeakBounds as PeakBounds
from .peak_bounds import peak_bounds as peak_bounds
