"""Controllers as the commands see them: start weights, build, parameters to tune."""
