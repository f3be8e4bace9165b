"""Machines as the commands see them: a nominal model, a family, sensors, limits."""
