"""Runs: from flags to a tuning problem, and from its end to results."""
