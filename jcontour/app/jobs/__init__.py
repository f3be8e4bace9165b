"""Jobs of a machine: contours, motions and the replay of a tuned run."""
