"""Controllers, one a file: each a plan made from the future, a memory and a step.

The names are in `__init__.pyi`; each loads its file when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
