"""Figures of tuning: points, fronts, ranks, sweeps, sensitivity."""
