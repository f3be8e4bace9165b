"""Moves that the words of a line ask for: end points, arcs, cycles, stops, in what modes."""
