"""Motion along a path: how far, and when."""
