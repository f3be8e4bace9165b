"""Papers reproduced, benchmarks and examples: they are in a checkout, not in the package."""
