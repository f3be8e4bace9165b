"""Differentiable simulation and gradient tuning of multi-axis contouring machines.

SI units; float64 unless JAX_ENABLE_X64=0.
"""

import os as _os
import sys as _sys
from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

_SINGLE = ("n", "no", "f", "false", "off", "0")  # the words that JAX takes for no
_GIVEN = _os.environ.get("JAX_ENABLE_X64", "")
if _GIVEN.lower() not in _SINGLE:
    # micrometres on metres, and the DARE, need double precision
    if "jax" in _sys.modules:
        _sys.modules["jax"].config.update("jax_enable_x64", True)
    elif not _GIVEN:  # JAX reads it when it is imported: what needs no JAX does not wait for it
        _os.environ["JAX_ENABLE_X64"] = "1"

if _TYPE_CHECKING:
    from jcontour.analysis.stability import frozen_spectral_radius, margins
    from jcontour.geometry import contours, toolpaths
    from jcontour.linear.plant import LinearPlant
    from jcontour.motion import feed_laws, references
    from jcontour.simulation.closed_loop import simulate
    from jcontour.simulation.evaluation import evaluate, stack_plants, stack_references
    from jcontour.simulation.metrics import score

__all__ = [
    "LinearPlant",
    "contours",
    "evaluate",
    "feed_laws",
    "frozen_spectral_radius",
    "margins",
    "references",
    "score",
    "simulate",
    "stack_plants",
    "stack_references",
    "toolpaths",
]
_HOMES = {  # name -> module that defines it
    "LinearPlant": "linear.plant",
    "evaluate": "simulation.evaluation",
    "frozen_spectral_radius": "analysis.stability",
    "margins": "analysis.stability",
    "score": "simulation.metrics",
    "simulate": "simulation.closed_loop",
    "stack_plants": "simulation.evaluation",
    "stack_references": "simulation.evaluation",
}
_MODULES = {
    "contours": "geometry.contours",
    "feed_laws": "motion.feed_laws",
    "references": "motion.references",
    "toolpaths": "geometry.toolpaths",
}


def __getattr__(name: str) -> _Any:
    """Object of this name, loaded when it is first asked for."""
    if name == "__version__":
        from importlib.metadata import version  # imported here: few ask for it

        return version("jcontour")
    if name in _MODULES:
        found = _import_module(f"jcontour.{_MODULES[name]}")
    elif name in _HOMES:
        found = getattr(_import_module(f"jcontour.{_HOMES[name]}"), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
