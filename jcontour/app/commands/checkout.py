"""Modules of `experiments`, which a checkout has and the installed package has not."""

from importlib import import_module
from types import ModuleType


def in_checkout(command: str, module: str) -> ModuleType:
    """A module of the papers or the benchmarks.

    Raises:
        ValueError: it is not there.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if not module.startswith(str(error.name)):  # a package that it needs
            raise
        raise ValueError(
            f"{command}: papers and benchmarks are not in the installed package; clone the "
            "repository and run it there"
        ) from None
