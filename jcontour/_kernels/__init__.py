"""Whole runs in one kernel, in Warp: for a GPU, and for a CPU where it is asked for.

Warp is the extra `fast` (and part of `cuda`). Without it everything is computed in plain JAX, which
is what the kernels are tested equal to.
"""

import os
from importlib.util import find_spec

from jcontour._devices import on_gpu, platform

SWITCH = "JCONTOUR_FAST"  # environment variable: 1 for the kernels on a CPU, 0 for none on a GPU


def enabled() -> bool:
    """Whether runs are computed by kernels: on a GPU, or where `JCONTOUR_FAST` is 1."""
    switch = os.environ.get(SWITCH, "1" if on_gpu() else "0")
    supported = on_gpu() or platform() == "cpu"
    return supported and switch == "1" and find_spec("warp") is not None
