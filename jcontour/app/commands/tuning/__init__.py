"""Commands that look for weights."""
