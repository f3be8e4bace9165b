"""Loops that Numba compiles for the CPU and XLA calls: for small matrices of many problems.

XLA makes a call of its own of every small operation of a loop; here a whole sweep is one.
"""
