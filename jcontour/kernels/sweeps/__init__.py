"""Riccati sweeps with time on the last axis, and those that LLVM compiles for a CPU."""
