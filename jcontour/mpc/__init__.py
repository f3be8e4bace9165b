"""Predictive controllers under limits: a QP at every sample, which `jcontour.qp` solves."""
