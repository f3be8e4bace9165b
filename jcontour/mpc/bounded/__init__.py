"""Predictive control that keeps its limits under every disturbance in a box."""
