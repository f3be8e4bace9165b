"""Predictive controllers, with a quadratic program at every sample."""
