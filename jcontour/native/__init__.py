"""Machine code of our own that XLA calls: for small matrices of many problems.

XLA makes a call of its own of every small operation of a loop; here a whole sweep is one. Programs
for a CPU are written by arithmetic in Python (`numbers`, `straight_line`) and called by a name
(`calls`); for a GPU LLVM compiles kernels as Pallas states them (`gpu_code`). Loops that run
without XLA are compiled by Numba (`lanes`).
"""
