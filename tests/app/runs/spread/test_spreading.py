import json
import os
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from jcontour.app.flags.tuning import Sweep, Tune
from jcontour.app.runs.spread.spreading import (
    ADDRESS,
    COUNT,
    NUMBER,
    _aside,
    _environment,
    batching_of,
    count_of,
)
from jcontour.simulation.devices import Spread


def test_devices_of_the_flags():
    assert count_of(Sweep()) is None and count_of(Tune()) == 1 and count_of(Tune(devices="4")) == 4
    for devices in ("0", "-1", "two", "1.5", ""):
        with pytest.raises(ValueError, match="devices: needs 'all' or a number"):
            count_of(Tune(devices=devices))
    assert batching_of(Tune()) is None
    assert isinstance(batching_of(Tune(devices="all")), Spread)
    with pytest.raises(ValueError, match="devices: needs 1 to 2"):
        batching_of(Tune(devices="3"))


def test_environment_of_the_hosts(monkeypatch):
    for name in (ADDRESS, COUNT, NUMBER):
        monkeypatch.delenv(name, raising=False)
    assert _environment() == {}
    monkeypatch.setenv(ADDRESS, "first:1234")
    monkeypatch.setenv(COUNT, "2")
    with pytest.raises(ValueError, match=f"{NUMBER} is missing"):
        _environment()
    monkeypatch.setenv(NUMBER, "one")
    with pytest.raises(ValueError, match="need whole numbers, received '2' and 'one'"):
        _environment()
    monkeypatch.setenv(NUMBER, "1")
    assert _environment() == {
        "coordinator_address": "first:1234",
        "num_processes": 2,
        "process_id": 1,
    }


def test_other_hosts_leave_nothing_behind(tmp_path, capsys):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "settings.json").write_text("{}")
    with ExitStack() as stack:
        new, resumed = _aside(Sweep(), stack), _aside(Sweep(resume=tmp_path / "run"), stack)
        print("unseen")
        assert new.out is not None and not new.out.exists()
        assert (
            resumed.resume != tmp_path / "run"
            and (resumed.resume / "settings.json").read_text() == "{}"
        )
    assert not resumed.resume.exists() and capsys.readouterr().out == ""


@pytest.mark.slow
def test_two_hosts_find_what_one_finds(tmp_path, machine_file):
    """Two processes on loopback, a CPU device each; the second prints and writes nothing."""
    words = "sweep circle --previews 4 --vary alpha=1,2 beta=1 --devices 1 --json --plant"
    call = [sys.executable, "-m", "jcontour.app.cli", *words.split(), str(machine_file)]
    alone = subprocess.run(
        [*call, "--out", str(tmp_path / "alone")], capture_output=True, text=True
    )
    assert alone.returncode == 0, alone.stderr
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    together = [*call, "--hosts", "--out", str(tmp_path / "together")]
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": tmp_path}
    first, second = (
        subprocess.Popen(together, **piped, env=host_environment(address, number))
        for number in range(2)
    )
    found, complaint = first.communicate(timeout=600)
    nothing, other_complaint = second.communicate(timeout=600)
    assert (first.returncode, second.returncode) == (0, 0), complaint + other_complaint
    assert nothing == "" and {path.name for path in tmp_path.iterdir()} == {"alone", "together"}
    agree(json.loads(alone.stdout), json.loads(found))


def host_environment(address, number):
    root = str(Path(__file__).parents[4])
    return {**os.environ, "PYTHONPATH": root, ADDRESS: address, COUNT: "2", NUMBER: str(number)}


def agree(one, other):
    """The same result but for the rounding of sums, the place and the time."""
    if isinstance(one, dict):
        assert set(one) == set(other)
        for name in set(one) - {"run", "seconds"}:
            agree(one[name], other[name])
    elif isinstance(one, list):
        for a, b in zip(one, other, strict=True):
            agree(a, b)
    elif isinstance(one, float):
        assert other == pytest.approx(one, rel=1e-9)
    else:
        assert one == other
