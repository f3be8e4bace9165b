"""Figures of results, one kind a file."""
