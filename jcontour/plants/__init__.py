"""Machines, one a file, and what stands between a controller and an ideal machine."""

from jcontour.plants.bridgeport import bridgeport
from jcontour.plants.wrappers import Delayed, Disturbed, Encoders, Quantised, Saturated

__all__ = ["Delayed", "Disturbed", "Encoders", "Quantised", "Saturated", "bridgeport"]
