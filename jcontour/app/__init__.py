"""The application: the `jcontour` command, its machines, jobs, results, tables and page.

Its door is for notebooks: `main` runs a command, `StoredRun` shows a run, and figures are drawn of
rollouts.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
