"""Vectors of eight numbers for loops that Numba compiles: the planner's, which run without XLA."""
