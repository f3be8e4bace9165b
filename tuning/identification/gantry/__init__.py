"""Masses, inertia, friction and stiffness of a gantry, from chirps on its drives."""
