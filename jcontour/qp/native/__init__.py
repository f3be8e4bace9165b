"""The interior point on a CPU: eight problems at once, compiled by Numba."""
