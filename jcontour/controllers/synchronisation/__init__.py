"""Axes that move together: adaptive, coupled, and how far the coupling may go."""
