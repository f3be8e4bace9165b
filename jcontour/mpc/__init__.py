"""Predictive controllers under limits: a QP at every sample, which `jcontour.qp` solves."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
