"""Certificates of a twisting gantry, and the interval arithmetic that they stand on."""
