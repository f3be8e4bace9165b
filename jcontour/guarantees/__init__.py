"""Guarantees: the largest errors that a loop can have, proven."""
