"""Loops that are compiled for the CPU and called by XLA: for small matrices of many problems.

XLA makes a call of its own of every small operation of a loop; here a whole sweep is one. Numba
compiles most of them (`calls`), LLVM alone the formulas over a plant's non-zeros (`straight_line`).
"""
