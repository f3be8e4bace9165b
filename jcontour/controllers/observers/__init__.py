"""Observers of states and disturbances."""
