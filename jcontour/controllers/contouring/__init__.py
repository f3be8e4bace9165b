"""Contouring schemes around a cascade."""
