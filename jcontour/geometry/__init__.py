"""Paths in arc length and the files they come from."""
