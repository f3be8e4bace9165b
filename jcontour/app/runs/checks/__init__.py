"""Checks of a loop before anybody loads it: limits, motion between samples, proofs, code."""
