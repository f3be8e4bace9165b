"""LQ controllers whose gains follow the path."""
