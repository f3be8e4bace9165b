"""Checks of a loop before anybody loads it: margins, random plants, limits, proofs."""
