"""`jcontour bench`: speed of the library on this computer.

Nothing is asserted. Every number has something measured beside it.
"""

import os
import platform
import time
from importlib import import_module
from pathlib import Path

from jcontour.app.commands.reproduce import in_checkout
from jcontour.app.files import run_folder
from jcontour.app.files.results.stored import to_json
from jcontour.app.flags.others import Bench
from jcontour.app.reports import tables

PACKAGES = (
    "numpy",
    "numba",
    "jax",
    "jaxlib",
    "warp-lang",
    "daqp",
    "proxsuite",
    "mujoco",
    "mujoco-mjx",
)
UNKNOWN = "unknown"
RECORDS = ("whole_way", "public")  # parts in a folder of `experiments/benchmarks`


def command(flags: Bench) -> int:
    """Measure and print one part.

    A part is a module with `measured(flags, tell)` and `tables(result)`. `tell` receives a line
    after every measurement; the lines appear on stderr as they come.
    """
    for name, least in (("seeds", 1), ("evaluations", 1), ("first_seed", 0)):
        if (value := getattr(flags, name)) < least:
            flag = name.replace("_", "-")
            raise ValueError(f"{flag}: needs at least {least}, received {value}")
    if any(batch < 1 for batch in flags.batch):
        raise ValueError(f"batch: needs at least one run at once, received {min(flags.batch)}")
    stored_results = in_checkout("bench", "experiments.benchmarks.stored_results")
    part = import_module(place_of(flags.what))
    progress = tables.console_of(stderr=True)
    machine = hardware()
    with progress.status("measuring: keep the computer quiet"):
        result = part.measured(flags, lambda line: tables.say(progress, line))
    rates = part.rates(result) if hasattr(part, "rates") else {}
    if flags.keep is not None and rates:
        stored_results.add(flags.keep, flags.what, machine, rates)
    if flags.json:
        numbers = to_json(result)
        rows = {"rows": numbers} if isinstance(numbers, list) else numbers
        print(run_folder.json_text({"machine": machine, **rows}))
        return 0
    console = tables.console_of()
    changes = stored_results.changes(flags.what, machine, rates)
    if changes is not None:
        console.print(changes)
    in_checkout("bench", "experiments.tables").show(console, part.tables(result))
    rows = [f"{name:<10} {value}" for name, value in machine.items()]
    tables.say(console, *rows, f"All numbers for a program: jcontour bench {flags.what} --json")
    return 0


def place_of(part: str) -> str:
    """Module of a part."""
    return f"experiments.benchmarks.{'records.' if part in RECORDS else ''}{part}"


def hardware() -> dict[str, str]:
    """The computer that the numbers belong to, and how busy it was before."""
    import jax

    load = f"{os.getloadavg()[0]:.2f}" if hasattr(os, "getloadavg") else UNKNOWN
    devices = jax.devices()
    versions = {name: run_folder.version_of(name) for name in PACKAGES}
    named = [f"{name} {version}" for name, version in versions.items() if version]
    model = platform.processor() or platform.machine()
    if (processors := Path("/proc/cpuinfo")).exists():
        lines = processors.read_text().splitlines()
        models = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
        model = next(iter(models), model)
    return {
        "cpu": f"{model}, {os.cpu_count()} cores",
        "devices": f"{len(devices)} x {devices[0].device_kind} ({devices[0].platform})",
        "load": f"{load} (one minute average, before)",
        "versions": ", ".join([*named, f"Python {platform.python_version()}"]),
        "date": time.strftime("%Y-%m-%d"),
    }
