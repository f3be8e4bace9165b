"""The closed loop in Python, for controllers that solve a QP at every sample."""
