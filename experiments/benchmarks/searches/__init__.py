"""The tuner beside searches without slopes."""
