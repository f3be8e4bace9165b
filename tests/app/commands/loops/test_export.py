"""`export` from the command line."""

import shutil

import numpy as np

from jcontour.app.cli import main
from jcontour.app.files.results.loop_results import ExportedResult


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


def test_a_tuned_run_has_its_margins_in_the_head_and_the_numbers_of_the_drive(tour):
    head = (tour("export-tuned").folder / "controller.h").read_text()
    assert "Margins: gain" in head and " in the family." in head
    assert tour("export-tuned").result(ExportedResult).precision == "single"
    assert "typedef float real;" in head


def test_a_contour_that_the_run_has_not_is_told(tour, capsys):
    assert main(["export", str(tour("simulate").folder), "--along", "moon"]) == 2
    assert "along: the run has part; received 'moon'" in capsys.readouterr().err


def test_a_run_without_a_controller_is_told(tmp_path, capsys):
    (tmp_path / "settings.json").write_text('{"command": "front", "flags": {}}')
    assert main(["export", str(tmp_path)]) == 2
    assert "a loop is stored by 'tune' and 'simulate'" in capsys.readouterr().err
