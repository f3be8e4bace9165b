"""The application: the `jcontour` command, its machines, jobs, results, tables and page.

Its door is for notebooks: `main` runs a command, `StoredRun` shows a run, and figures are drawn of
rollouts.

A fault of the user's input is a `ValueError` whose text is the line that the command prints, from
every function of the application; a docstring names only what else it raises.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
