from . import contours as contours
from . import toolpaths as toolpaths
from .periodic_splines import polar_lobes as polar_lobes
