"""Machines found from records of hidden ones, and what that is worth."""
