"""Wrappers around any plant: encoders, delays, saturation, disturbances."""
