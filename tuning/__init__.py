"""Tuning by gradient: weights in, closed-loop metrics out, better weights back. Knows controllers and plants only by their contracts."""
