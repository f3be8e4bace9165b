"""Tuning by gradient: weights in, closed-loop metrics out, better weights back.

The tuner knows controllers and plants only by their contracts. The names are in `__init__.pyi`;
each is loaded when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
