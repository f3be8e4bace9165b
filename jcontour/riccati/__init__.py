"""Riccati equations: the sweep over a run and the algebraic equation."""
