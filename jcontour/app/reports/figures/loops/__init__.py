"""Figures of closed loops: runs, motions, feeds, certificates."""
