"""Machines, one a file, and what stands between a controller and an ideal machine.

The names are in `__init__.pyi`; each loads its file when it is first used.
"""

import lazy_loader

from jcontour.plants.xy_table import xy_table as xy_table  # its file has the same name

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
