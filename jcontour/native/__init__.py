"""Machine code of our own that XLA calls: for small matrices of many problems.

XLA makes a call of its own of every small operation of a loop; here a whole sweep is one. For a CPU
Numba compiles most of them (`calls`), LLVM alone the formulas over a plant's non-zeros
(`straight_line`). For a GPU LLVM compiles kernels as Pallas states them (`gpu_code`).
"""
