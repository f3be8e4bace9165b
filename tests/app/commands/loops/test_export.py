"""`export` from the command line."""

import json
import shutil

import numpy as np

from jcontour.app.cli import main
from jcontour.app.files.results.loop_results import ExportedResult, SimulatedResult
from jcontour.app.files.results.stored import read_result


def test_a_simulated_run_becomes_a_law_that_gives_its_controls(tour):
    out, found = tour("export").folder, tour("export").result(ExportedResult)
    assert (found.states, found.preview) == (6, 4)  # two axes of two states, and their loads
    assert found.difference < 1e-12 * found.largest_control
    assert [one.compiler.split()[0] for one in found.compiled] == [
        name for name in ("gcc", "clang") if shutil.which(name)
    ]
    for one in found.compiled:
        assert one.difference < 1e-12 * found.largest_control
        assert one.code_bytes < 40_000 and one.memory_bytes < 4_000
    assert {path.name for path in out.iterdir()} == {*found.files, "result.json", "settings.json"}
    head = (out / "law.h").read_text()
    assert "Family: nominal; gains 1.1, 0.9;" in head and "Margins: not known" in head
    assert "LREAL" in (out / "law.st").read_text()
    for line in found.limits:
        assert line in head
    rows = np.loadtxt(out / "check.csv", delimiter=",", skiprows=1)
    assert len(rows) == found.samples + found.preview + 1


def test_a_tuned_run_has_its_margins_in_the_head_and_the_numbers_of_the_drive(tour):
    head = (tour("export-tuned").folder / "law.h").read_text()
    assert "Margins: gain" in head and " in the family." in head
    found = tour("export-tuned").result(ExportedResult)
    assert found.precision == "single" and "typedef float real;" in head
    assert all(one.difference < 1e-3 * found.largest_control for one in found.compiled)


def test_a_contour_that_the_run_has_not_is_told(tour, capsys):
    assert main(["export", str(tour("simulate").folder), "--along", "moon"]) == 2
    assert "along: the run has part; received 'moon'" in capsys.readouterr().err


def test_a_run_without_a_controller_is_told(tmp_path, capsys):
    (tmp_path / "settings.json").write_text('{"command": "front", "flags": {}}')
    assert main(["export", str(tmp_path)]) == 2
    assert "a loop is stored by 'tune' and 'simulate'" in capsys.readouterr().err


def test_a_check_in_linuxcnc_takes_no_flags_of_other_checks(tour, capsys):
    run = str(tour("simulate").folder)
    for flags, words in (
        (["--bound"], "--in-linuxcnc does not go with --bound"),
        (["--force", "1"], "--force does not go with --in-linuxcnc"),
        (["--max-control", "1"], "--max-control does not go with --in-linuxcnc"),
    ):
        assert main(["check", run, "--in-linuxcnc", *flags]) == 2
        assert words in capsys.readouterr().err


def test_backlash_is_compensated_in_a_run_and_left_to_the_control_in_its_code(
    tmp_path, machine_fields, part_file, monkeypatch, capsys
):
    """The code gives the controls of the run, whose reference leads; the remedy can be typed."""
    monkeypatch.chdir(tmp_path)
    noisy = {"backlash": 0.02, "encoder_noise": [1e-6, 2e-6]}  # of each axis: arrays
    (tmp_path / "loose.json").write_text(json.dumps(machine_fields | noisy))
    task, errors = [str(part_file), "--plant", "loose.json", "--preview", "4", "--details"], []
    for name, flags in (("as-it-is", []), ("led", ["--backlash"])):
        main(["simulate", *task, *flags, "--out", name])
        errors.append(read_result(tmp_path / name, SimulatedResult).plants["nominal"])
    loose, led = errors
    assert led.rms_contour_error < 0.8 * loose.rms_contour_error
    assert led.rms_tracking_error < 0.7 * loose.rms_tracking_error
    assert "--backlash" in capsys.readouterr().out.split("Next")[-1].split("Folder")[0]
    assert main(["export", "led", "--python", "--out", "code"]) == 0
    found = read_result(tmp_path / "code", ExportedResult)
    assert found.difference < 1e-12 * found.largest_control
    assert any("does not compensate the backlash, 20, 20 um" in line for line in found.warnings)
