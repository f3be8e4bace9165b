"""Model predictive contouring control: the controller chooses its own speed along the path."""
