"""Ways down: one descent, its quadratic programs, the way to stable loops, and the end inside."""
