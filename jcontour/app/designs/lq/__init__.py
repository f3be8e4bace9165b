"""LQ contouring with an observer: weights, first loop, limits."""
