"""The closed loop as a scan, and its metrics."""
