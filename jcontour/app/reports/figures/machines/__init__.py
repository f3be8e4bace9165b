"""Figures of machines and of their records."""
