"""Tracking of a reference under limits: one QP per sample, on the host or under `jit`."""
