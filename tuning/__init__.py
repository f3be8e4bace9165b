"""Tuning by gradient: weights in, closed-loop metrics out, better weights back.

The tuner knows controllers and plants only by their contracts. All files are reached from here, as
`tuning.tune.tune` or `tuning.problem.Problem`; each is imported when it is first used.
"""

from importlib import import_module
from types import ModuleType

_PARTS = (
    "descents",
    "effort",
    "exchange",
    "history",
    "identification",
    "loops",
    "objectives",
    "outcome",
    "parameters",
    "pareto",
    "point",
    "precompensation",
    "problem",
    "sweep",
    "tune",
    "verify",
)


def __getattr__(name: str) -> ModuleType:
    """A file or a room of the tuner, on first use."""
    if name in _PARTS:
        return import_module(f"tuning.{name}")
    raise AttributeError(f"module 'tuning' has no attribute {name!r}")
