"""Differentiable simulation and gradient tuning of multi-axis contouring machines.

SI units; float64 unless JAX_ENABLE_X64=0.
"""

import os as _os

import jax as _jax

if _os.environ.get("JAX_ENABLE_X64", "1") not in ("0", "false", "False"):
    # micrometres on metres, and the DARE, need double precision
    _jax.config.update("jax_enable_x64", True)

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


def __getattr__(name: str) -> str:
    if name == "__version__":
        from importlib.metadata import version  # imported here: few ask for it

        return version("jcontour")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
