"""One quadratic program: its data, its solvers, its residuals."""
