"""`export` from the command line."""

import shutil

import numpy as np
import pytest

from experiments.cli import main
from experiments.files.results.exported_result import ExportedResult
from experiments.files.results.stored import read_result

SHORT = ("--preview", "4")  # of controllers that see ahead


def simulated(folder, machine_file, part_file, *flags):
    words = ["--plant", str(machine_file), "--json", "--out", str(folder)]
    assert main(["simulate", str(part_file), *words, *flags]) in (
        0,
        3,
    )  # its limits are not looked at here
    return folder


def test_a_simulated_run_becomes_code_that_gives_its_controls(tour):
    out, found = tour("export").folder, tour("export").result(ExportedResult)
    assert found.states == 6  # two axes of two states, a load on each control
    assert found.difference < 1e-12 * found.largest_control
    assert [one.compiler.split()[0] for one in found.compiled] == [
        name for name in ("gcc", "clang") if shutil.which(name)
    ]
    assert all(one.difference < 1e-12 * found.largest_control for one in found.compiled)
    assert {path.name for path in out.iterdir()} == {*found.files, "result.json", "settings.json"}
    plan = (out / "plan.csv").read_text().partition("\n")[0]
    unit = "control_unit"
    assert plan.startswith(f"k,t_s,f1_{unit},f2_{unit},r1_m,r2_m,F1_{unit}_per_state_1,")
    head = (out / "controller.h").read_text()
    assert "Family: nominal; gains 1.1, 0.9;" in head and "Margins: not known" in head
    assert "LREAL" in (out / "controller.st").read_text()
    rows = np.loadtxt(out / "plan.csv", delimiter=",", skiprows=1)
    assert len(rows) == found.samples > 149  # those of the part, and rest
    assert np.abs(rows[-1, 2:4]).max() < 0.05 * found.largest_control  # at rest
    assert np.all(rows[-1, 4:6] == 0)  # where the program ends
    # no counts: the reference asks for half of the machine's 4 m/s^2, in samples of 2 ms
    assert np.abs(np.diff(rows[:, 4:6], 2, axis=0)).max() < 2.001 * 0.002**2
    for line in (found.start, found.end):
        assert line in head and line in (out / "controller.st").read_text()
    assert found.start.startswith("Start at rest at the path's first point: y1 = 0.0000 mm, y2 =")
    assert found.end == "End: the plan rests at the last sample; hold that sample."


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "flags"),
    [("preview-lq", SHORT), ("contouring-lq-state", SHORT), ("linear-cascade", ())],
)
def test_other_controllers_have_a_linear_form(
    tmp_path, machine_file, part_file, name, flags, capsys
):
    run = simulated(tmp_path / "run", machine_file, part_file, "--controller", name, *flags)
    out = tmp_path / "exported"
    assert main(["export", str(run), "--single", "--out", str(out)]) == 0
    told = capsys.readouterr().out
    found = read_result(out, ExportedResult)
    assert found.precision == "single" and found.gain_sets >= 1
    assert "Next: compile controller.c" in told and "no warning" in told
    assert "typedef float real;" in (out / "controller.h").read_text()
    assert ("MOST[2]" in (out / "controller.c").read_text()) is (name == "linear-cascade")
    assert not found.warnings
    with (out / "plan.csv").open() as plan:
        measured = [word[0] == "r" for word in plan.readline().split(",")]
        rows = np.loadtxt(plan, delimiter=",")[:, measured]
    assert np.abs(rows[-1]).max() < 1e-12  # at rest where the program ends, positions and state


@pytest.mark.slow
def test_what_a_step_beside_the_start_does_is_told(tmp_path, machine_file, part_file, capsys):
    """A cascade without its integral: gains position and velocity, and 0.1 mm in one sample."""
    flags = ["--controller", "linear-cascade", "--weights", "position=30", "velocity=800"]
    flags += ["integral_time=1e9"]
    run = simulated(tmp_path / "run", machine_file, part_file, *flags)
    assert main(["export", str(run), "--out", str(tmp_path / "exported")]) == 0
    wanted = 800 * (30 + 1 / 0.002) * 1e-4
    assert (
        f"From 0.1 mm beside it the control jumps by up to {wanted:.3g} " in capsys.readouterr().out
    )


def test_a_tuned_run_has_its_margins_in_the_head(tour):
    head = (tour("export-tuned").folder / "controller.h").read_text()
    assert "Margins: gain" in head and " in the family." in head


@pytest.mark.slow
def test_what_cannot_be_exported_is_told_in_a_line(tmp_path, machine_file, part_file, capsys):
    run = simulated(tmp_path / "run", machine_file, part_file, "--controller", "adaptive-zpetc")
    assert main(["export", str(run), "--out", str(tmp_path / "none")]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "adaptive-zpetc has no linear form" in told
    assert not (tmp_path / "none").exists()
    assert main(["export", str(run), "--along", "moon"]) == 2
    assert "along: the run has part; received 'moon'" in capsys.readouterr().err


def test_a_run_without_a_controller_is_told(tmp_path, capsys):
    (tmp_path / "settings.json").write_text('{"command": "front", "flags": {}}')
    assert main(["export", str(tmp_path)]) == 2
    assert "a loop is stored by 'tune' and 'simulate'" in capsys.readouterr().err
