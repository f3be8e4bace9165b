"""What a machine does: contours, motions and the replay of a tuned run."""
