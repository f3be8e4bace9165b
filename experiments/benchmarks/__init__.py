"""Rates and times, each as a ratio against something run beside it."""
