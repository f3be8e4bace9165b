"""Text of a program: lines, expressions, parameters, O-words, and the codes it may contain."""
