"""The gantry in MuJoCo: the same machine in an engine of another make."""
