"""Every bad input: one clear line on stderr, exit code 2, nothing written."""

import json
import os
import signal
import subprocess
import sys
import time
import warnings
from importlib.metadata import version

import pytest

from experiments import cli
from experiments.catalogue.known_names import FIRST_LINES
from experiments.cli import main

# command -> module that reads its parts
PARTS_READ = {"tune": "runs.tuning.problem", "simulate": "commands.loops.simulate"}


def refused(capsys, folder, arguments, says):
    before = sorted(folder.rglob("*"))
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert (
        captured.err.startswith("jcontour: ")
        and captured.err.count("\n") == 1
        and "Traceback" not in captured.err
    )
    assert says in captured.err
    assert captured.out == ""
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(
    ("program", "says"),
    [
        ("G1 X1\n", "line 1"),
        ("G1 Q7 F100\n", "line 1"),
        ("G1 X1 F100\nG2 X5 Y5 I0.1 J0\n", "line 2"),
        ("G1 X0 F100\n", "cutting"),
        ("", "cutting"),
    ],
)
def test_bad_part(capsys, tmp_path, program, says):
    part = tmp_path / "part.ngc"
    part.write_text(program)
    refused(capsys, tmp_path, ["tune", str(part), "--out", str(tmp_path / "run")], says)


def test_missing_part(capsys, tmp_path):
    refused(
        capsys,
        tmp_path,
        ["tune", str(tmp_path / "none.ngc"), "--out", str(tmp_path / "run")],
        "none.ngc",
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--alpha", "-1"], "alpha"),
        (["--alpha", "0", "--beta", "0"], "alpha, beta"),
        (["--alpha", "nan"], "alpha: needs a finite number"),
        (["--tolerance", "inf"], "tolerance: needs a finite number, received inf"),
        (["--feed-mm-per-min", "-inf"], "feed-mm-per-min: needs a finite number"),
        (["--weights", "alpha=1_0"], "received 'alpha=1_0'"),
        (["--rho", "0"], "rho"),
        (["--preview", "0"], "preview"),
        (["--preview", "500"], "preview: 500 samples are more than the"),
        (["--preview", "path"], "preview: path is for the one run of simulate"),
        (["--feed-mm-per-min", "0"], "feed"),
        (["--max-tracking-error-um", "-3"], "max-tracking-error-um"),
        (["--max-effort", "0"], "max-effort"),
        (["--max-effort", "1.2", "--max-rms-control", "90"], "give one of them"),
        (["--scatter", "-1"], "scatter"),
        (["--plant", "lathe"], "lathe"),
        (["--plant", "lathe.json"], "lathe.json"),
        (["--devices", "some"], "devices"),
        (["--devices", "3"], "devices: needs 1 to 2"),
        (["--resume", "nowhere"], "nowhere"),
        (["--resume", "nowhere", "--seed", "3"], "leave out --seed"),
    ],
)
def test_bad_flag(capsys, tmp_path, part_file, machine_file, flags, says):
    where = [] if "--resume" in flags else [str(part_file), "--out", str(tmp_path / "run")]
    machine = [] if "--plant" in flags or "--resume" in flags else ["--plant", str(machine_file)]
    refused(capsys, tmp_path, ["tune", *where, *machine, *flags], says)


@pytest.mark.parametrize("flag", ["--alpha", "--preview", "--max-effort"])
@pytest.mark.parametrize("number", ["1_0", " 1", "１", "one"])
def test_numbers_are_in_plain_digits(capsys, flag, number):
    with pytest.raises(SystemExit) as stop:
        main(["tune", flag, number])
    assert stop.value.code == 2
    assert "in plain digits" in " ".join(capsys.readouterr().err.replace("│", "").split())


@pytest.mark.parametrize(
    ("name", "text", "number"),
    [("alpha", "+1.5e-1", 0.15), ("alpha", ".5", 0.5), ("max_effort", "2", 2.0), ("seed", "7", 7)],
)
def test_plain_numbers_are_read(monkeypatch, name, text, number):
    received = []
    monkeypatch.setattr(
        "experiments.commands.tuning.tune.command", lambda flags: received.append(flags)
    )
    main(["tune", f"--{name.replace('_', '-')}", text])
    assert getattr(received[0], name) == number


@pytest.mark.parametrize("command", ["tune", "simulate"])
def test_a_fault_of_the_part_is_told_before_a_controller_is_designed(
    capsys, tmp_path, monkeypatch, command
):
    def designed(machine, flags):
        raise AssertionError("the design came first")

    monkeypatch.setattr(f"experiments.{PARTS_READ[command]}.design_for", designed)
    part = tmp_path / "part.ngc"
    # its first lines are checked before anything is loaded
    part.write_text("G0 X1\n" * FIRST_LINES + "G1 X2\n")
    where = f"line {FIRST_LINES + 1}"
    refused(capsys, tmp_path, [command, str(part), "--out", str(tmp_path / "run")], where)


def test_no_stabilising_solution(capsys, tmp_path, part_file, machine_fields):
    path = tmp_path / "machine.json"
    path.write_text(
        json.dumps({**machine_fields, "B": [[0.0, 0.0], [0.4, 0.0], [0.0, 0.0], [0.0, 0.0]]})
    )
    refused(
        capsys,
        tmp_path,
        ["tune", str(part_file), "--plant", str(path), "--out", str(tmp_path / "run")],
        "out of reach",
    )


@pytest.mark.slow
def test_folder_of_another_run(capsys, tmp_path, machine_file, part_file):
    taken = tmp_path / "run"
    taken.mkdir()
    (taken / "settings.json").write_text("{}")
    flags = ["tune", str(part_file), "--plant", str(machine_file), "--out", str(taken)]
    refused(capsys, tmp_path, flags, "already holds another run")


@pytest.mark.parametrize(
    "arguments",
    [["simulate", "spiral"], ["simulate", "--controller", "magic"], ["reproduce", "nothing"]],
)
def test_unknown_name(capsys, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    refused(capsys, tmp_path, arguments, arguments[-1])


def test_traceback_on_request(monkeypatch):
    """A ValueError may be a fault of the program: then one has to see where it comes from."""
    monkeypatch.setenv("JCONTOUR_TRACEBACK", "1")
    with pytest.raises(ValueError, match="lathe"):
        main(["simulate", "--plant", "lathe"])


def test_help_names_the_traceback(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "JCONTOUR_TRACEBACK=1" in capsys.readouterr().out


def test_list_as_json(capsys):
    assert main(["list", "--json"]) == 0
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    assert set(found) == {"plants", "controllers", "constrained", "contours", "experiments"}
    assert "bridgeport" in found["plants"] and "mpcc" in found["constrained"]


def test_help_imports_nothing_heavy():
    script = (
        "import sys\nfrom experiments.cli import main\n"
        "try:\n main(['tune', '--help'])\nexcept SystemExit: pass\n"
        "assert not {'jax', 'matplotlib', 'xarray', 'scipy'} & set(sys.modules), sys.modules.keys()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


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
    compared = subprocess.run(
        [*command[:-1], "compare", str(tmp_path / "alone"), str(tmp_path / "killed"), "--json"],
        capture_output=True,
        text=True,
    )
    summary = json.loads(compared.stdout)
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


@pytest.mark.slow
def test_simulate(tmp_path, machine_file):
    command = [
        sys.executable,
        "-m",
        "experiments.cli",
        "simulate",
        "circle",
        "--plant",
        str(machine_file),
        "--json",
    ]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "run")], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["contour"] == "circle"
    assert {path.name for path in (tmp_path / "run").glob("*.*")} >= {
        "settings.json",
        "result.json",
        "rollouts.nc",
        "contour-circle.png",
    }


def test_the_environment_is_set_before_jax_and_what_is_there_stays(tmp_path):
    """In a process of its own: this one has loaded JAX, and then nothing changes."""
    program = (
        "import os, sys, experiments.cli as cli; assert 'numpy' not in sys.modules;"
        "cli.keep_to_one_thread(); cli.choose_compiler(); cli.keep_compiled();"
        "print(os.environ['XLA_FLAGS']); print(os.environ['JAX_COMPILATION_CACHE_DIR']);"
        "print(os.environ['OPENBLAS_NUM_THREADS'])"
    )
    ours = ("JAX_", "XLA_", "OPENBLAS_")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(ours)}
    chosen = "--xla_cpu_multi_thread_eigen=false"
    if version("jaxlib").startswith("0.10."):
        chosen += " --xla_cpu_use_fusion_emitters=false"
    cases = [
        ({}, chosen, str(tmp_path / "jcontour" / "compiled"), "1"),
        (
            {
                "XLA_FLAGS": "--one=1",
                "JAX_COMPILATION_CACHE_DIR": "mine",
                "OPENBLAS_NUM_THREADS": "3",
            },
            f"--one=1 {chosen}",
            "mine",
            "3",
        ),
    ]
    for given, *expected in cases:
        environment = {**kept, "XDG_CACHE_HOME": str(tmp_path), **given}
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True
        )
        assert done.stdout.splitlines() == expected, done.stderr


@pytest.mark.parametrize(
    ("category", "said"),
    [(UserWarning, "jcontour: WARNING: beta is 9\n"), (RuntimeWarning, "RuntimeWarning: beta is")],
)
def test_a_warning_is_told_as_every_message_is(category, said, monkeypatch, capsys):
    def answered(arguments):
        warnings.simplefilter("always")
        warnings.warn("beta is\n9", category, stacklevel=1)
        return 0

    monkeypatch.setattr(cli, "_answered", answered)
    assert cli.main([]) == 0
    assert said in capsys.readouterr().err


def test_a_compiled_program_that_is_cut_off_is_compiled_anew_and_told(tmp_path):
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(tmp_path / "programs")}
    environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    environment["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
    program = "import jax; from experiments import cli; cli._answered = lambda _: "
    program += "print(jax.jit(lambda x: 2.0 * x)(3.0)); cli.main([])"
    told = f"it is compiled anew each time until {tmp_path / 'programs'} is deleted\n"
    for wanted in ("", told):
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True
        )
        assert done.stdout == "6.0\n" and done.stderr.endswith(wanted)
        assert bool(done.stderr) is bool(wanted) and "Traceback" not in done.stderr
        kept = list((tmp_path / "programs").glob("*-cache"))
        assert kept
        for entry in kept:
            entry.write_bytes(entry.read_bytes()[:20])


def test_who_has_seen_enough_hears_no_complaint():
    listing = [sys.executable, "-m", "experiments.cli", "list"]
    told = subprocess.Popen(listing, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert told.stdout is not None
    assert told.stderr is not None
    told.stdout.close()
    assert told.stderr.read() == b""
    assert told.wait() == 1
    told.stderr.close()
