"""`check --bound` from the command line. Words of a certificate."""

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from jcontour.app.cli import main
from jcontour.app.commands.loops.check_bound import ATTACK, sentences, show_certified, verdict_on
from jcontour.app.files.netcdf import load_dataset
from jcontour.app.files.results.bound_results import CertifiedResult, CertifiedRow
from jcontour.app.files.results.run_metrics import MachineSummary, PeakPlace
from jcontour.app.files.results.tuned_result import TunedResult
from jcontour.app.files.results.verdict import Verdict

ROW = CertifiedRow(
    contour="circle",
    plant="late",
    bound=8e-6,
    nominal=1e-6,
    reached=6e-6,
    counted=5e-6,
    control=(1.0, 2.5),
    place=PeakPlace("late", 8e-6, 0.1, (1e-3, 2e-3)),
)
RESULT = CertifiedResult(
    certified="runs/one",
    machine=MachineSummary("table", "A", ("X", "Y"), "quantised encoders"),
    controller="contouring-lq",
    error="contour",
    force=0.1,
    encoder=4e-7,
    control_limit=(10.0, 3.0),
    gain=None,
    rows=[ROW],
    verdict=Verdict.of([]),
)


@pytest.fixture
def simulated(tour):
    return tour("simulate").folder


def test_every_plant_of_a_simulated_run_is_certified(tour):
    out, result = tour("check-bound").folder, tour("check-bound").result(CertifiedResult)
    assert len(result.rows) == 4 and result.force == 0.5 and result.encoder == 0.5e-6
    for row in result.rows:
        assert row.nominal < row.reached <= row.bound and row.counted <= row.bound
        assert row.reached > 0.9 * row.bound
        assert max(row.control) < 300.0
    data = load_dataset(out / ATTACK)
    assert data.plant == result.worst.plant
    assert np.abs(data.force.values).max() == 0.5 and np.abs(data.noise.values).max() == 0.5e-6
    scored = data.scored.values.astype(bool)
    assert data.bound.values[scored].max() == result.worst.bound
    assert data.reached.values[scored].max() == result.worst.reached
    assert (out / "certificate.png").exists()


def test_a_tuned_run_is_certified_with_its_weights(tour):
    result = tour("check-bound-tuned").result(CertifiedResult)
    assert result.force == 1.0  # control_noise of the machine file
    proven = tour("tune").result(TunedResult).certified
    assert proven.error == pytest.approx(result.worst.bound, rel=1e-9)
    assert (proven.contour, proven.plant) == (result.worst.contour, result.worst.plant)
    assert all(row.reached <= row.bound for row in result.rows)


def test_faults_are_told_in_a_line_and_nothing_is_written(simulated, tmp_path, capsys):
    out = tmp_path / "none"
    faults = {
        "force: a bound needs to be finite and at least zero, is -1.0": ("--force", "-1"),
        "encoder-um: rounding alone errs by half a count, 0.5 um": ("--encoder-um", "0.1"),
        "cells: needs at least zero, received -1": ("--cells", "-1"),
    }
    for line, flags in faults.items():
        assert main(["check", str(simulated), "--bound", *flags, "--out", str(out)]) == 2
        assert line in capsys.readouterr().err
    assert not out.exists()


def test_a_run_without_a_loop_is_told(tmp_path, capsys):
    assert main(["check", str(tmp_path), "--bound"]) == 2
    assert "settings.json" in capsys.readouterr().err
    (tmp_path / "settings.json").write_text('{"command": "front", "flags": {}}')
    assert main(["check", str(tmp_path), "--bound"]) == 2
    told = capsys.readouterr().err
    assert "holds a run of 'front'; a loop is stored by 'tune' and 'simulate'" in told


def test_assumptions_attack_place_and_controls_are_said():
    text = "\n".join(sentences(RESULT))
    assert "force of up to 0.1 A on each control" in text
    assert "encoder error of up to 0.4 um" in text
    assert "--force and --encoder-um set these bounds" in text
    assert "An attack reaches 75 % of the largest bound" in text
    assert "largest contour error 8 um at X 1, Y 2 mm" in text
    assert "No control exceeds 1 A on input 1, 2.5 A on input 2." in text


def test_every_encoder_has_its_own_bound():
    text = "\n".join(sentences(replace(RESULT, encoder=(4e-7, 2e-6))))
    assert "encoder error of up to 0.4 um on X, 2 um on Y, at each sample" in text


def test_the_plants_of_the_proof_are_said():
    assert "Not for plants between them" in " ".join(sentences(RESULT))
    every = " ".join(sentences(replace(RESULT, gain=0.1)))
    assert "every constant gain from 0.9 to 1.1 on each axis" in every


def test_a_control_beyond_the_limit_of_its_own_input_is_not_to_be_used():
    """Input 1 may have 10 A and input 2 only 3 A."""
    within = verdict_on([ROW, replace(ROW, control=(4.0, 1.0))], (10.0, 3.0), "A")
    assert within.exit_code == 0 and [one.value for one in within.limits] == [4.0, 2.5]
    beyond = verdict_on([ROW, replace(ROW, control=(4.0, 3.5), plant="early")], (10.0, 3.0), "A")
    assert beyond.exit_code == 3
    assert beyond.reasons[0] == "control of input 2 EXCEEDS its limit: 3.5 of 3 A (circle, early)"
    assert verdict_on([ROW], None, "A").limits == []


def test_the_table_has_every_error_in_um():
    console = Console(width=120, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    show_certified(RESULT, console)
    line = next(one for one in console.export_text().splitlines() if "late" in one)
    assert line.split() == ["circle", "late", "8", "6", "5", "1", "1,", "2.5"]
