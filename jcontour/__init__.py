"""Differentiable simulation and gradient tuning of multi-axis contouring machines.

SI units; float64 unless JAX_ENABLE_X64=0. The names are in `__init__.pyi`; each is loaded when it
is first used.
"""

import os as _os
import sys as _sys

import lazy_loader as _lazy_loader

_SINGLE = ("n", "no", "f", "false", "off", "0")  # the words that JAX takes for no
_GIVEN = _os.environ.get("JAX_ENABLE_X64", "")
if _GIVEN.lower() not in _SINGLE:
    # micrometres on metres, and the DARE, need double precision
    if "jax" in _sys.modules:
        _sys.modules["jax"].config.update("jax_enable_x64", True)
    elif not _GIVEN:  # JAX reads it when it is imported: what needs no JAX does not wait for it
        _os.environ["JAX_ENABLE_X64"] = "1"

__getattr__, __dir__, __all__ = _lazy_loader.attach_stub(__name__, __file__)
