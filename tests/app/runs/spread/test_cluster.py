"""Answers of calls: in this process, on one worker and on two, with workers that are killed."""

import signal
import socket
import sys
from importlib.metadata import version

import psutil
import pytest

from jcontour.app.runs.spread.cluster import PACKAGES, Killed, answers, check_versions, cluster_of

ONCE = """
import os, pathlib, signal

def once(path):
    \"\"\"Kill the process that first comes here, and answer the next one.\"\"\"
    if not pathlib.Path(path).exists():
        pathlib.Path(path).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 'done'
"""


def test_a_worker_with_other_versions_is_refused():
    here = {name: version(name) for name in PACKAGES}
    check_versions({"tcp://a": here})
    with pytest.raises(ValueError, match="scheduler: a worker has daqp 0.1, this computer"):
        check_versions({"tcp://a": here, "tcp://b": here | {"daqp": "0.1"}})


def test_without_workers_calls_are_made_here():
    with cluster_of(0, None) as client:
        assert client is None
        assert list(answers(abs, [-1, -2], client)) == [(0, 1), (1, 2)]


@pytest.mark.parametrize(("workers", "scheduler"), [(2, None), (None, "tcp://127.0.0.1:1")])
def test_without_the_extra_one_line_says_how_to_install_it(monkeypatch, workers, scheduler):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match="uv run --extra cluster .*; --workers 0 computes"):
        with cluster_of(workers, scheduler):
            pass


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr("jcontour.app.runs.spread.cluster.WAITED", 1)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(ValueError, match=f"scheduler: {address} does not answer"):
        with cluster_of(None, address):
            pass
    with pytest.raises(ValueError, match="scheduler: nowhere:port does not answer"):
        with cluster_of(None, "nowhere:port"):
            pass


@pytest.mark.slow
def test_a_cluster_that_runs_already_is_joined_and_stays():
    from distributed import Client, LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as running:
        with (
            pytest.warns(UserWarning, match="runs code"),
            cluster_of(None, running.scheduler_address) as client,
        ):
            assert dict(answers(abs, [-1, -2, -3], client)) == {0: 1, 1: 2, 2: 3}
        with Client(running) as client:
            assert len(client.nthreads()) == 1


@pytest.mark.slow
def test_killed_workers_lose_one_call_and_a_killer_has_no_answer(tmp_path, monkeypatch):
    """On one worker, so that every killing hits the process that all other calls need."""
    (tmp_path / "killing.py").write_text(ONCE)
    monkeypatch.syspath_prepend(tmp_path)
    once = __import__("killing").once
    with cluster_of(1, None) as client:
        found = dict(answers(once, [str(tmp_path / "a"), str(tmp_path / "b")], client))
        assert found == {0: "done", 1: "done"}
        harmless = signal.SIGCHLD  # has no effect
        signals = [harmless, signal.SIGKILL, harmless]
        found = dict(answers(signal.raise_signal, signals, client))
    assert found == {0: None, 1: Killed(), 2: None}


@pytest.mark.slow
def test_what_a_call_raises_ends_all():
    with cluster_of(1, None) as client:
        with pytest.raises(ValueError, match="invalid literal"):
            list(answers(int, ["1", "one"], client))


@pytest.mark.slow
def test_workers_leave_an_interruption_to_the_command_and_listen_to_this_computer_alone():
    with cluster_of(1, None) as client:
        found = client.run(signal.getsignal, signal.SIGINT)
        ours = psutil.Process()
        sockets = [
            one
            for process in (ours, *ours.children(recursive=True))
            for one in process.net_connections("tcp")
            if one.status == psutil.CONN_LISTEN
        ]
    assert list(found.values()) == [signal.SIG_IGN]
    assert sockets and {one.laddr.ip for one in sockets} == {"127.0.0.1"}
