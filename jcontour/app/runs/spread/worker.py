"""Work that a process of a cluster is sent. Imports nothing heavy: JAX is set up first."""

import os
import pickle
import platform
import signal
import sys
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any, NamedTuple

PACKAGES = ("jcontour", "jax", "jaxlib", "equinox", "numpy", "scipy", "daqp", "numba")
SETTINGS = ("XLA_FLAGS", "JAX_ENABLE_X64")  # of the environment, that digits may depend on


class Surroundings(NamedTuple):
    """What the digits of a result depend on beside its input."""

    versions: Mapping[str, str]
    settings: Mapping[str, str | None]

    @classmethod
    def here(cls) -> "Surroundings":
        """Those of this process."""
        versions = {name: version(name) for name in PACKAGES}
        settings = {name: os.environ.get(name) for name in SETTINGS}
        return cls({"python": platform.python_version(), **versions}, settings)


def answer(work: bytes, wanted: Surroundings) -> Any:
    """Answer of a pickled (function, argument), in the surroundings of whoever asks.

    Raises:
        ValueError: this process has other versions, or has set JAX up otherwise.
    """
    if "jax" not in sys.modules:
        _set_up(wanted.settings)
    here = Surroundings.here()
    for own, others in zip(here, wanted, strict=True):
        for name in others:
            if own[name] != others[name]:
                raise ValueError(
                    f"scheduler: a worker has {name} {own[name]}, this computer {others[name]}"
                )
    call, argument = pickle.loads(work)
    return call(argument)


def _set_up(settings: Mapping[str, str | None]) -> None:
    """Set the environment of a process that has not loaded JAX; designs run on the CPU."""
    os.environ["JAX_PLATFORMS"] = "cpu"
    for name, value in settings.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


def dask_setup(worker: Any) -> None:
    """Leave an interruption to the process that asks; dask calls this in workers of our own."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
