"""Properties of a closed loop: margins and spectral radii."""
