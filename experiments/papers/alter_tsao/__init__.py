"""Alter & Tsao: optimal feedforward of a linear-motor drive."""
