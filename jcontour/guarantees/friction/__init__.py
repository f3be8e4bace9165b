"""Largest errors of a flexible axis with stick, slip and cogging."""
