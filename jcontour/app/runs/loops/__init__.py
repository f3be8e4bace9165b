"""Runs of one loop: at several feeds, bent, lap by lap."""
