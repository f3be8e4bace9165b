"""Certificates for every constant gain of a plant between bounds."""
