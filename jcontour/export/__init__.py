"""Linear controllers as code for a drive: C99, IEC 61131-3 structured text, plain NumPy."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
