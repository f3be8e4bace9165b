"""Many calls of one function, in this process or in those of a dask cluster, with equal answers.

A call whose process is killed is tried once more, when it can harm no other. Then it has no answer,
and the others go on.
"""

import logging
import os
import signal
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from jcontour.app.flags.tuning import Sweep
from jcontour.app.runs.spread.spreading import cores

if TYPE_CHECKING:  # an extra
    from distributed import Client, Future

EXTRA = (
    "needs the extra `cluster` (uv run --extra cluster jcontour ...); "
    "--workers 0 computes in this process"
)
WAITED = 30  # [s] for a scheduler and its first worker
# digits of a result depend on these, and on a setting of the environment
PACKAGES = ("jcontour", "jax", "jaxlib", "equinox", "numpy", "scipy", "daqp", "numba")
FLAGS = "XLA_FLAGS"


@dataclass(frozen=True)
class Killed:
    """In place of an answer: every process that the call was given was killed."""


@contextmanager
def cluster_of(
    workers: int | None, scheduler: str | None, listen: str = Sweep.listen
) -> "Iterator[Client | None]":
    """A cluster to compute on; None for this process.

    Args:
        workers: processes on this computer, one for each core when not given; 0 for none.
        scheduler: address of a cluster that runs already, instead.
        listen: address of this computer on which the cluster's page is served.

    Raises:
        ValueError: the extra is not installed, no cluster answers, or it has other versions.
    """
    if scheduler is None and workers == 0:
        yield None
        return
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError:
        raise ValueError(f"{'scheduler' if scheduler else 'workers'}: {EXTRA}") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what is lost is told by us
    if scheduler is not None:
        with _joined(scheduler) as client:
            yield client
        return
    with (
        config.set({"distributed.scheduler.allowed-failures": 1}),
        LocalCluster(
            n_workers=workers or cores(),
            threads_per_worker=1,
            dashboard_address=f"{listen}:0",  # any port
            worker_dashboard_address=f"{listen}:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        # an interruption is left to the process that asks
        client.run(_prepare, os.environ.get(FLAGS), signal.SIGINT)
        yield client


@contextmanager
def _joined(scheduler: str) -> "Iterator[Client]":
    from distributed import Client

    try:
        client = Client(scheduler, timeout=WAITED)
    except (OSError, ValueError) as error:
        raise ValueError(f"scheduler: {scheduler} does not answer ({error})") from None
    if not scheduler.startswith("tls"):
        warnings.warn(
            f"scheduler: whoever reaches {scheduler} runs code on its workers, and may answer in "
            "their place with code that runs here; use it where everyone is trusted, or with tls",
            stacklevel=2,
        )
    with client:
        try:
            client.wait_for_workers(1, timeout=WAITED)
        except TimeoutError:
            raise ValueError(f"scheduler: {scheduler} has no worker") from None
        found: dict[str, dict[str, str]] = client.run(_prepare, os.environ.get(FLAGS))  # pyright: ignore[reportAssignmentType]
        check_versions(found)
        yield client


def _prepare(flags: str | None, ignored: int | None = None) -> dict[str, str]:
    """Set a worker up before it loads JAX; versions that digits depend on."""
    os.environ["JAX_PLATFORMS"] = "cpu"  # designs run step by step
    if flags is not None:
        os.environ[FLAGS] = flags
    if ignored is not None:
        signal.signal(ignored, signal.SIG_IGN)
    return {name: version(name) for name in PACKAGES}


def check_versions(workers: dict[str, dict[str, str]]) -> None:
    """Refuse a cluster whose digits may be others.

    Raises:
        ValueError: a worker has another version of a package.
    """
    for name in PACKAGES:
        for found in workers.values():
            if found[name] != version(name):
                raise ValueError(
                    f"scheduler: a worker has {name} {found[name]}, this computer {version(name)}"
                )


def answers(
    call: Callable[[Any], Any], arguments: Sequence[Any], client: "Client | None"
) -> Iterator[tuple[int, Any]]:
    """Place and answer of every call, as they come in; `Killed` where there is none.

    Raises:
        ValueError: the cluster is lost; or whatever a call raises.
    """
    if client is None:
        yield from ((place, call(argument)) for place, argument in enumerate(arguments))
        return
    from distributed import as_completed

    places = {client.submit(call, one, pure=False): k for k, one in enumerate(arguments)}
    lost = []
    for future in as_completed(places):
        answer = _answer_of(future)
        if isinstance(answer, Killed):
            lost.append(places[future])
        else:
            yield places[future], answer
    for place in lost:  # one at a time
        yield place, _answer_of(client.submit(call, arguments[place], pure=False))


def _answer_of(future: "Future") -> Any:
    from distributed import CancelledError, KilledWorker

    try:
        return future.result()
    except KilledWorker:
        return Killed()
    except CancelledError as error:
        raise ValueError(
            f"workers: the cluster is lost ({error}); what was found is kept: --resume"
        ) from None
