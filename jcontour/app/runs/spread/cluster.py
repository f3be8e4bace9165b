"""Many calls of one function, in this process or in those of a dask cluster, with equal answers.

A process that is killed loses the call that it was at: another one is given it. A call that kills
one process after the other has no answer, and the others go on.
"""

import logging
import pickle
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jcontour.app.flags.tuning import Sweep
from jcontour.app.runs.spread import worker
from jcontour.app.runs.spread.spreading import cores
from jcontour.app.runs.spread.worker import Surroundings, answer

if TYPE_CHECKING:  # an extra
    from distributed import Client, Future

EXTRA = (
    "needs the extra `cluster` (uv run --extra cluster jcontour ...); "
    "--workers 0 computes in this process"
)
PATIENCE, LOOKS = 10, 3  # [s] between looks, and looks that find no worker, until it is replaced
LOST = 1  # processes that a call may kill before it is set aside, in a cluster of our own
WAITED = 30  # [s] for a scheduler and its first worker


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
        ValueError: the extra is not installed, or no cluster answers.
    """
    if scheduler is None and workers == 0:
        yield None
        return
    name = "workers" if scheduler is None else "scheduler"
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError:
        raise ValueError(f"{name}: {EXTRA}") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what is lost is told by us
    if scheduler is not None:
        with _joined(scheduler) as client:
            yield client
        return
    with (
        config.set({"distributed.scheduler.allowed-failures": LOST}),
        LocalCluster(
            n_workers=workers or cores(),
            threads_per_worker=1,
            dashboard_address=f"{listen}:0",  # any port
            worker_dashboard_address=f"{listen}:0",
            silence_logs=logging.CRITICAL,
            preload=[worker.__name__],
        ) as cluster,
        Client(cluster) as client,
    ):
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
        yield client


def answers(
    call: Callable[[Any], Any], arguments: Sequence[Any], client: "Client | None"
) -> Iterator[tuple[int, Any]]:
    """Place and answer of every call, as they come in; `Killed` where there is none.

    No more calls are under way than the processes have threads. Ours have one each: a process that
    is killed takes one call with it.
    A call whose processes were killed is tried again by itself, when it can harm no other.

    Raises:
        ValueError: a call cannot be sent, the cluster is lost, or whatever a call raises.
    """
    if client is None:
        yield from ((place, call(argument)) for place, argument in enumerate(arguments))
        return
    lost = []
    for place, future in _finished(client, call, dict(enumerate(arguments)), _threads):
        if _was_killed(future):
            lost.append(place)
        else:
            yield place, _answer_of(future)
    alone = {place: arguments[place] for place in lost}
    for place, future in _finished(client, call, alone, lambda _: 1):
        yield place, Killed() if _was_killed(future) else _answer_of(future)


def _finished(
    client: "Client",
    call: Callable[[Any], Any],
    arguments: dict[int, Any],
    at_once: "Callable[[Client], int]",
) -> "Iterator[tuple[int, Future]]":
    waiting, places = iter(arguments.items()), {}
    surroundings = Surroundings.here()

    def fill() -> None:
        while len(places) < at_once(client) and (following := next(waiting, None)) is not None:
            place, argument = following
            future = client.submit(
                answer, _packed(call, argument), surroundings, pure=False, retries=0
            )
            places[future] = place

    fill()
    while places:
        for future in _done(client, list(places)):
            yield places.pop(future), future
        fill()


def _done(client: "Client", futures: "list[Future]") -> "Iterable[Future]":
    """Those that are done, one at least; workers of our own that are gone are replaced.

    A nanny starts a worker anew that was killed, but not always one that was killed at its start.
    """
    from distributed import CancelledError, wait

    looks = 0
    while True:
        try:
            done: Any = wait(futures, timeout=PATIENCE, return_when="FIRST_COMPLETED")
            return done.done
        except CancelledError as error:
            raise _lost(error) from None
        except TimeoutError:  # the calls take so long, or nobody is at them
            looks = 0 if _workers(client) else looks + 1
            if looks >= LOOKS:
                _replace_workers(client)
                looks = 0


def _workers(client: "Client") -> int:
    try:
        threads: Any = client.nthreads()
    except OSError as error:
        raise _lost(error) from None
    return sum(threads.values())


def _replace_workers(client: "Client") -> None:
    cluster: Any = client.cluster
    if cluster is None:
        raise _lost("it has no worker left")
    count = len(cluster.worker_spec)
    cluster.scale(0)
    cluster.scale(count)
    try:
        client.wait_for_workers(1, timeout=WAITED)
    except TimeoutError:
        raise _lost("no worker starts") from None


def _lost(why: object) -> ValueError:
    return ValueError(f"workers: the cluster is lost ({why}); what was found is kept: --resume")


def _threads(client: "Client") -> int:
    return max(1, _workers(client))


def _was_killed(future: "Future") -> bool:
    from distributed import KilledWorker

    return future.status == "error" and isinstance(future.exception(), KilledWorker)


def _answer_of(future: "Future") -> Any:
    if future.status not in ("finished", "error"):
        raise _lost(future.status)
    return future.result()


def _packed(call: Callable[[Any], Any], argument: Any) -> bytes:
    try:
        return pickle.dumps((call, argument))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ValueError(
            f"workers: another process cannot be sent this ({error}); --workers 0 computes here"
        ) from None
