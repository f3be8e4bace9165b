"""Contouring schemes of the field, tuned alike and compared."""
