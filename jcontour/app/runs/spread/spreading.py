"""Work spread over devices and hosts, as `--devices` and `--hosts` say.

Every host runs the same command. The first one prints and keeps the run folder; the others do the
same in a folder of their own that is thrown away, so that nothing else needs to know of them.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from jcontour.app.flags.shared import Spreading
from jcontour.simulation.evaluation import Batching

ADDRESS, COUNT, NUMBER = "JAX_COORDINATOR_ADDRESS", "JAX_NUM_PROCESSES", "JAX_PROCESS_ID"
F = TypeVar("F", bound=Spreading)


def count_of(flags: Spreading) -> int | None:
    """Devices of every host that the flags ask for; None is all.

    Raises:
        ValueError: neither `all` nor a number above zero.
    """
    if flags.devices == "all":
        return None
    if not flags.devices.isdecimal() or int(flags.devices) < 1:
        raise ValueError(f"devices: needs 'all' or a number above zero, received {flags.devices!r}")
    return int(flags.devices)


def batching_of(flags: Spreading) -> Batching | None:
    """How batches are spread; None on a single device.

    Raises:
        ValueError: a host has fewer devices.
    """
    from jcontour.simulation.devices import Spread, device_mesh

    mesh = device_mesh(count_of(flags))
    return Spread(mesh) if mesh.size > 1 else None


@contextmanager
def prepared(flags: F) -> Iterator[F]:
    """Set devices and hosts up, before anything is computed; the flags that this host goes on with.

    Raises:
        ValueError: the flags or the environment do not say what is needed.
    """
    import jax

    try:
        jax.config.update(
            "jax_num_cpu_devices", min(count_of(flags) or cores(), cores())
        )  # a CPU is as many as it is told to be
    except RuntimeError:  # called from a program that has computed already: its devices stay
        pass
    if not flags.hosts:
        yield flags
        return
    with ExitStack() as stack:
        stack.enter_context(_stdout_for_python())
        import jax
        from jax.experimental.multihost_utils import sync_global_devices

        try:
            jax.distributed.initialize(**_environment())
        except ValueError as error:
            needed = (
                f"set {ADDRESS} (host:port of the first host), {COUNT} and {NUMBER} on every host, "
                "or start it by a cluster manager"
            )
            raise ValueError(f"hosts: {needed} ({error})") from None
        # connect the devices while all hosts are here: later, one that compiles for longer than the
        # others is given up after half a minute
        sync_global_devices("joined")
        yield flags if jax.process_index() == 0 else _aside(flags, stack)


def cores() -> int:
    """Cores of this computer that the process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _stdout_for_python() -> Iterator[None]:
    """Send to stderr what the library that connects the hosts prints from outside Python."""
    with os.fdopen(os.dup(1), "w") as ours, redirect_stdout(ours):
        os.dup2(2, 1)
        try:
            yield
        finally:
            ours.flush()
            os.dup2(ours.fileno(), 1)


def _environment() -> dict[str, Any]:
    """Hosts by the standard variables; empty where JAX has to ask the cluster manager."""
    given = {name: os.environ[name] for name in (ADDRESS, COUNT, NUMBER) if os.environ.get(name)}
    if not given:
        return {}
    missing = [name for name in (ADDRESS, COUNT, NUMBER) if name not in given]
    if missing:
        raise ValueError(f"{', '.join(missing)} is missing")
    try:
        return {
            "coordinator_address": given[ADDRESS],
            "num_processes": int(given[COUNT]),
            "process_id": int(given[NUMBER]),
        }
    except ValueError:
        received = f"{given[COUNT]!r} and {given[NUMBER]!r}"
        raise ValueError(f"{COUNT} and {NUMBER} need whole numbers, received {received}") from None


def _aside(flags: F, stack: ExitStack) -> F:
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="jcontour-"))) / "run"
    stack.enter_context(redirect_stdout(stack.enter_context(Path(os.devnull).open("w"))))
    if flags.resume is None:
        return replace(flags, out=folder)
    return replace(flags, resume=Path(shutil.copytree(flags.resume, folder)))
