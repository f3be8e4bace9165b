"""From flags to a tuning problem, through its search to results."""
