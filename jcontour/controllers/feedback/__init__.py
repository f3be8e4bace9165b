"""Feedback controllers with fixed gains."""
