"""A run of the gantry as a film."""
