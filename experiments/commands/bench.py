"""`jcontour bench`: how fast the library is on this computer. Nothing is asserted; every number has something measured beside it."""

import os
import platform
import time
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

from experiments.files import run_folder
from experiments.options import Bench
from experiments.reports import tables

PACKAGES = ("numpy", "numba", "jax", "jaxlib", "daqp", "proxsuite", "mujoco", "mujoco-mjx")


def command(flags: Bench) -> int:
    """Measure and print one part: a module with `rows(flags)` and `show(console, rows)`."""
    part = import_module(f"experiments.bench_{flags.what}")
    console, summary = tables.console_of(quiet=flags.json), {"machine": hardware()}
    with console.status("measuring: keep the computer quiet"):
        summary = run_folder.plain({**summary, **part.rows(flags)})
    if flags.json:
        print(run_folder.json_text(summary))
        return 0
    part.show(console, summary)
    tables.say(console, *(f"{name:<10} {value}" for name, value in summary["machine"].items()))
    return 0


def hardware() -> dict[str, str]:
    """What the numbers belong to, and how busy it was before."""
    import jax

    try:
        with open("/proc/cpuinfo") as file:
            model = next(
                (line.split(":")[1].strip() for line in file if line.startswith("model name")),
                platform.processor(),
            )
    except OSError:
        model = platform.processor() or platform.machine()
    load = f"{os.getloadavg()[0]:.2f}" if hasattr(os, "getloadavg") else "unknown"
    devices = jax.devices()
    return {
        "cpu": f"{model}, {os.cpu_count()} cores",
        "devices": f"{len(devices)} x {devices[0].device_kind} ({devices[0].platform})",
        "load": f"{load} (one minute average, before)",
        "versions": ", ".join(f"{name} {found}" for name in PACKAGES if (found := _version(name)))
        + f", Python {platform.python_version()}",
        "date": time.strftime("%Y-%m-%d"),
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
