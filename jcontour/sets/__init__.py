"""Finite impulse responses, invariant sets and polytopes: guarantees for bounded disturbances."""
