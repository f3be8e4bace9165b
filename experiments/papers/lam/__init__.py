"""Lam, Manzie & Good: model predictive contouring control of an X-Y table."""
