"""The closed loop in Python, for controllers that solve a QP at every sample."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
