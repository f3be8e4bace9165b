"""Every bad input: one clear line on stderr, exit code 2, nothing written."""

import json
import os
import subprocess
import sys
import warnings
from importlib import import_module

import jax
import numpy as np
import pytest

from jcontour.app import cli
from jcontour.app.catalogue.entries import MACHINES
from jcontour.app.catalogue.known_names import FIRST_LINES, check_plant
from jcontour.app.cli import main
from jcontour.app.flags.loops import Simulate
from jcontour.app.flags.tuning import Tune

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
        (["--alpha", "0", "--beta", "0"], "--alpha, --beta: "),
        (["--alpha", "nan"], "alpha: needs a finite number"),
        (["--weights", "alpha=1_0"], "received 'alpha=1_0'"),
        (["--rho", "0"], "rho"),
        (["--preview", "0"], "preview"),
        (["--preview", "500"], "preview: 500 samples are more than the"),
        (["--preview", "path"], "preview: path is for the one run of simulate"),
        (["--feed-mm-per-min", "0"], "feed"),
        (["--max-effort", "0"], "max-effort"),
        (["--max-effort", "1.2", "--max-rms-control", "90"], "give one of them"),
        (["--plant", "lathe"], "lathe"),
        (["--plant", "lathe.json"], "lathe.json"),
        (["--resume", "nowhere"], "nowhere"),
        (["--resume", "nowhere", "--seed", "3"], "leave out --seed"),
        (["circle", "a b.ngc", "--resume", "nowhere"], "leave out circle 'a b.ngc'"),
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
        "jcontour.app.commands.tuning.tune.command", lambda flags: received.append(flags)
    )
    main(["tune", f"--{name.replace('_', '-')}", text])
    assert getattr(received[0], name) == number


def test_single_precision_is_refused(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("JAX_ENABLE_X64", "off")
    refused(capsys, tmp_path, ["simulate", "circle"], "JAX_ENABLE_X64=off: single precision")
    monkeypatch.delenv("JAX_ENABLE_X64")
    with jax.enable_x64(False):
        refused(capsys, tmp_path, ["simulate", "circle"], "single precision")


def test_a_platform_that_is_missing_is_named_in_one_line(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "jcontour.app.cli", "simulate", "circle", "--out", tmp_path / "run"],
        env=os.environ | {"JAX_PLATFORMS": "abacus"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("jcontour: JAX_PLATFORMS=abacus: ")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("command", ["tune", "simulate"])
def test_a_fault_of_the_part_is_told_before_a_controller_is_designed(
    capsys, tmp_path, monkeypatch, command
):
    def designed(machine, flags):
        raise AssertionError("the design came first")

    monkeypatch.setattr(f"jcontour.app.{PARTS_READ[command]}.design_for", designed)
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


@pytest.mark.parametrize(
    ("said", "typed"),
    [
        ("max-effort: needs more", "--max-effort: needs more"),
        ("alpha, beta: both are zero", "--alpha, --beta: both are zero"),
        ("contour: there is none", "contour: there is none"),  # it is typed without a flag
        ("alpha.json: dt: missing", "alpha.json: dt: missing"),
        ("alpha", "alpha"),
    ],
)
def test_a_message_begins_with_flags_as_they_are_typed(capsys, monkeypatch, said, typed):
    def fail(flags):
        raise ValueError(said)

    flags = Simulate() if said.startswith("contour") else Tune()
    monkeypatch.setattr(cli, "_chosen", lambda _: (flags, fail))
    monkeypatch.setattr(cli, "_check_folders", lambda _: None)
    assert cli.main([]) == 2
    assert capsys.readouterr().err.endswith(f"jcontour: {typed}\n")


def test_numbers_of_a_lost_loop_overflow_without_a_word(capsys, monkeypatch):
    def overflow(_):
        size = np.array([1e300, np.inf])
        assert np.isnan(size * size - np.inf).all()
        assert np.isinf(size.astype("f4")).all() and np.isinf(size / np.zeros(2)).all()
        return 0

    monkeypatch.setattr(cli, "_answered", overflow)
    assert cli.main([]) == 0
    assert capsys.readouterr().err == ""


def test_a_taken_run_folder_is_told_before_the_work(capsys, tmp_path, monkeypatch):
    """No command is loaded: it would begin its work."""
    taken, file = tmp_path / "run", tmp_path / "file"
    taken.mkdir()
    (taken / "settings.json").write_text("{}")
    file.write_text("")

    def loaded(name):
        assert not name.startswith("jcontour.app.commands"), name
        return import_module(name)

    monkeypatch.setattr(cli, "import_module", loaded)
    for command, folder, words in (
        ("tune", taken, "already holds something; give another --out"),
        ("simulate", taken, "already holds something; give another --out"),
        ("simulate", file, "is a file; a run needs a folder"),
    ):
        assert cli.main([command, "circle", "--out", str(folder)]) == 2
        assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [["simulate", "spiral"], ["simulate", "--controller", "magic"], ["reproduce", "nothing"]],
)
def test_unknown_name(capsys, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    refused(capsys, tmp_path, arguments, arguments[-1])


@pytest.mark.parametrize("name", ["check", "export", "report"])
def test_a_missing_run_folder_is_told_with_what_makes_one(capsys, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    told = f"{name}: needs a run folder; `jcontour tune PART` makes one and prints its name\n"
    refused(capsys, tmp_path, [name], told)


def test_this_folder_may_be_the_run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "settings.json").write_text('{"command": "front", "flags": {}}')
    refused(capsys, tmp_path, ["check"], "holds a run of 'front', not of 'tune'")


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
    kinds = {"plants", "controllers", "constrained", "contours", "experiments"}
    assert set(found) == kinds
    assert "bridgeport" in found["plants"] and "mpcc" in found["constrained"]
    assert found["plants"].keys() == MACHINES.keys()
    for name in found["plants"]:
        check_plant(name)


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


def test_who_has_seen_enough_hears_no_complaint():
    listing = [sys.executable, "-m", "jcontour.app.cli", "list"]
    told = subprocess.Popen(listing, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert told.stdout is not None
    assert told.stderr is not None
    told.stdout.close()
    assert told.stderr.read() == b""
    assert told.wait() == 1
    told.stderr.close()
