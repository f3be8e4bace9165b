"""Wrappers around any plant: encoders, delays, gains, saturation, disturbances."""
