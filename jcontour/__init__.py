"""Differentiable simulation and gradient tuning of multi-axis contouring machines. SI units, float64 unless JAX_ENABLE_X64=0."""

import os as _os

import jax as _jax

if _os.environ.get("JAX_ENABLE_X64", "1") not in ("0", "false", "False"):
    _jax.config.update("jax_enable_x64", True)  # micrometres on metres, and the DARE, need double precision
