"""Commands that make a machine file."""
