"""Long commands that are killed or stopped with Ctrl-C, and resumed."""

import json
import signal
import subprocess
import sys
import time

import pytest


@pytest.mark.slow
def test_whole_run_killed_and_resumed(tmp_path, machine_file, part_file):
    """Run killed in the middle (kill -9) and resumed.

    Its result is that of a run left alone, to the last bit.
    """
    command = [sys.executable, "-m", "experiments.cli", "tune"]
    effort = [
        "--scatter",
        "3",
        "--starts",
        "2",
        "--steps",
        "4",
        "--json",
    ]
    make = [*command, str(part_file), "--plant", str(machine_file), *effort]
    alone = subprocess.run(
        [*make, "--out", str(tmp_path / "alone")], capture_output=True, text=True
    )
    assert alone.returncode == 0, alone.stderr
    killed = subprocess.Popen([*make, "--out", str(tmp_path / "killed")], stdout=subprocess.DEVNULL)
    while not (tmp_path / "killed" / "state.npz").exists() and killed.poll() is None:
        time.sleep(0.02)
    killed.kill()
    killed.wait()
    assert not (tmp_path / "killed" / "result.json").exists()
    resumed = subprocess.run(
        [*command, "--resume", str(tmp_path / "killed"), "--json"], capture_output=True, text=True
    )
    assert resumed.returncode == 0, resumed.stderr
    first, second = json.loads(alone.stdout), json.loads(resumed.stdout)
    for one in (first, second):
        del one["run"], one["seconds"]
    assert first == second
    for name in ("gains.csv", "observer.json", "history.json"):
        assert (tmp_path / "alone" / name).read_bytes() == (tmp_path / "killed" / name).read_bytes()
    both = [str(tmp_path / name) for name in ("alone", "killed")]
    compared = subprocess.run(
        [*command[:-1], "report", *both, "--no-page", "--json"],
        capture_output=True,
        text=True,
    )
    (summary,) = json.loads(compared.stdout)["comparisons"]
    assert (
        summary["settings"] == {} and summary["better"]["first"] == summary["better"]["second"] == 0
    )


# command -> flags, the file that tells that it is in the middle, the files that have to agree
LONG = {
    "front": (
        "circle --points 2 --preview 4 --max-sensitivity None".split(),  # no loops to look at
        "budget-0/state.npz",
        ("result.json", "budgets.json"),
    ),
    "sweep": (
        ["circle", "--vary", "alpha=1,2,4", "beta=0,1,5,20", "--previews", "4", "6"],
        "parts",
        ("result.json",),
    ),
}


def long_command(command, machine_file):
    """The call without a folder at its end."""
    flags = [*LONG[command][0], "--plant", str(machine_file), "--json", "--out"]
    return [sys.executable, "-m", "experiments.cli", command, *flags]


@pytest.fixture(scope="module", params=LONG)
def left_alone(request, tmp_path_factory, machine_file):
    """(name, folder) of a long command that nobody stopped."""
    folder = tmp_path_factory.mktemp("alone") / "run"
    make = [*long_command(request.param, machine_file), str(folder)]
    done = subprocess.run(make, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return request.param, folder


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_long_commands_stopped_and_resumed(tmp_path, machine_file, left_alone, how):
    """The same files as from a run that was left alone; Ctrl-C says in one line how to go on."""
    command, alone = left_alone
    _, middle, agree = LONG[command]
    make = long_command(command, machine_file)
    stopped = subprocess.Popen(
        [*make, str(tmp_path / "stopped")],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not (tmp_path / "stopped" / middle).exists() and stopped.poll() is None:
        time.sleep(0.01)
    stopped.send_signal(how)
    _, complaint = stopped.communicate()
    assert not (tmp_path / "stopped" / "result.json").exists()
    if how == signal.SIGINT:
        assert (
            stopped.returncode == 130
            and len(complaint.splitlines()) == 1
            and "--resume" in complaint
        )
    again = [*make[:4], "--resume", str(tmp_path / "stopped"), "--json"]
    resumed = subprocess.run(again, capture_output=True, text=True)
    assert resumed.returncode == 0, resumed.stderr
    for name in agree:
        assert (alone / name).read_bytes() == (tmp_path / "stopped" / name).read_bytes()
