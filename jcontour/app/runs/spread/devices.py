"""Devices that a run is spread over, as `--devices` says."""

import os

from jcontour.app.flags.shared import Storage
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
    import jax

    owned = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    try:
        jax.config.update("jax_num_cpu_devices", min(count_of(flags) or owned or 1, owned or 1))
    except RuntimeError:  # called from a program that has computed already: its devices stay
        pass


def batching_of(flags: Storage) -> Batching | None:
    """Batches spread over the devices; None on a single device."""
    from jcontour.simulation.devices import Spread, device_mesh

    mesh = device_mesh(count_of(flags))
    return Spread(mesh) if mesh.size > 1 else None
