"""Devices that a run is spread over, as `--devices` says."""

import os
import sys
from typing import TYPE_CHECKING

from jcontour.app.flags.shared import Storage

if TYPE_CHECKING:  # what is refused loads no JAX
    from jcontour.simulation.evaluation import Batching


def count_of(flags: Storage) -> int | None:
    """Devices that the flags ask for; None is all."""
    if flags.devices == "all":
        return None
    if not flags.devices.isdecimal() or int(flags.devices) < 1:
        raise ValueError(f"devices: needs 'all' or a number above zero, received {flags.devices!r}")
    return int(flags.devices)


def set_up(flags: Storage) -> None:
    """Split the CPU into as many devices as the flags ask for, before anything is computed."""
    owned = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    count = min(count_of(flags) or owned or 1, owned or 1)
    os.environ["JAX_NUM_CPU_DEVICES"] = str(count)  # JAX reads it when it is imported
    try:
        if "jax" in sys.modules:
            sys.modules["jax"].config.update("jax_num_cpu_devices", count)
    except RuntimeError:  # called from a program that has computed already: its devices stay
        pass


def batching_of(flags: Storage) -> "Batching | None":
    """Batches spread over the devices; None on a single device."""
    from jcontour.simulation.devices import Spread, device_mesh

    mesh = device_mesh(count_of(flags))
    return Spread(mesh) if mesh.size > 1 else None
