"""Sets of contours: drawn at random, held out, or representing a long program."""
