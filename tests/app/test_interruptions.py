"""Long commands that are killed or stopped with Ctrl-C, and resumed."""

import json
import signal
import subprocess
import sys
import time

import pytest

COMMAND = [sys.executable, "-m", "jcontour.app.cli"]


@pytest.mark.slow
def test_whole_run_killed_and_resumed(tmp_path, machine_file, part_file):
    """Run killed in the middle (kill -9) and resumed.

    Its result is that of a run left alone, to the last bit.
    """
    effort = "--scatter 1 --starts 1 --steps 2 --json".split()
    make = [*COMMAND, "tune", str(part_file), "--plant", str(machine_file), *effort]
    alone = subprocess.run(
        [*make, "--out", str(tmp_path / "alone")], capture_output=True, text=True
    )
    assert alone.returncode in (0, 3), alone.stderr  # so short a search may end in DO NOT USE
    killed = subprocess.Popen([*make, "--out", str(tmp_path / "killed")], stdout=subprocess.DEVNULL)
    while not (tmp_path / "killed" / "state.npz").exists() and killed.poll() is None:
        time.sleep(0.02)
    killed.kill()
    killed.wait()
    assert not (tmp_path / "killed" / "result.json").exists()
    resumed = subprocess.run(
        [*COMMAND, "tune", "--resume", str(tmp_path / "killed"), "--json"],
        capture_output=True,
        text=True,
    )
    assert resumed.returncode == alone.returncode, resumed.stderr
    first, second = json.loads(alone.stdout), json.loads(resumed.stdout)
    for one in (first, second):
        del one["run"], one["seconds"]
    assert first == second
    for name in ("gains.csv", "observer.json", "history.json"):
        assert (tmp_path / "alone" / name).read_bytes() == (tmp_path / "killed" / name).read_bytes()


@pytest.mark.slow
def test_a_sweep_stopped_with_ctrl_c_and_resumed(tmp_path, machine_file):
    """The same result as from a run that was left alone; one line says how to go on."""
    words = "sweep circle --vary alpha=1,2,4 beta=0,1,5,20 --previews 4 6 --json --plant"
    make = [*COMMAND, *words.split(), str(machine_file), "--out"]
    alone = subprocess.run([*make, str(tmp_path / "alone")], capture_output=True, text=True)
    assert alone.returncode == 0, alone.stderr
    stopped = subprocess.Popen(
        [*make, str(tmp_path / "stopped")],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not (tmp_path / "stopped" / "parts").exists() and stopped.poll() is None:
        time.sleep(0.01)
    stopped.send_signal(signal.SIGINT)
    _, complaint = stopped.communicate()
    assert stopped.returncode == 130 and not (tmp_path / "stopped" / "result.json").exists()
    assert len(complaint.splitlines()) == 1 and "--resume" in complaint
    again = [*COMMAND, "sweep", "--resume", str(tmp_path / "stopped"), "--json"]
    resumed = subprocess.run(again, capture_output=True, text=True)
    assert resumed.returncode == 0, resumed.stderr
    results = [(tmp_path / name / "result.json").read_bytes() for name in ("alone", "stopped")]
    assert results[0] == results[1]


WAITS = "    time.sleep(60)"
# as pandas, whose compiled modules answer Ctrl-C with ImportError
LOADS = """    try: time.sleep(60)
    except KeyboardInterrupt: raise ImportError('no module') from None"""
# as zipfile's, whose destructor needs what a whole __init__ leaves
BUILDS = """    class File:
        def __init__(self): time.sleep(60)
        def __del__(self): self.whole
    File()"""
# as JAX's, which clears its caches when Python collects garbage
COLLECTS = """    class Caches:
        def __del__(self): time.sleep(60)
    Caches()
    time.sleep(60)"""
ENDINGS = [(signal.SIGINT, body) for body in (WAITS, LOADS, BUILDS, COLLECTS)]


@pytest.mark.parametrize(("number", "body"), [(signal.SIGTERM, WAITS), *ENDINGS])
def test_a_command_that_is_ended_from_outside_says_so_in_one_line(number, body):
    program = (
        "import sys, time\n"
        "from jcontour.app import cli\n"
        "def begun(_):\n"
        "    print('begun', flush=True)\n"
        f"{body}\n"
        "cli._chosen = begun\n"
        "sys.exit(cli.main())"
    )
    ended = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert ended.stdout is not None and ended.stdout.readline() == "begun\n"
    ended.send_signal(number)
    assert ended.communicate() == ("", "jcontour: interrupted\n")
    assert ended.returncode == 130
