"""Constrained control on the host: a QP at every step, solved and checked; the only place that imports solvers."""
