"""`check --bound` from the command line. Words of a certificate."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from jcontour.analysis.frozen_loops import unlimited
from jcontour.app.cli import main
from jcontour.app.commands.loops.check_bound import (
    ATTACK,
    Bounds,
    certified_runs,
    promised,
    verdict_on,
)
from jcontour.app.files.results.loop_results import CertifiedResult, CertifiedRow
from jcontour.app.files.results.run_metrics import PeakPlace
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.runs.stored_loops import stored_loop

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
    data = xr.load_dataset(out / ATTACK)
    assert data.plant == result.worst.plant
    assert np.abs(data.force.values).max() == 0.5 and np.abs(data.noise.values).max() == 0.5e-6
    scored = data.scored.values.astype(bool)
    assert data.bound.values[scored].max() == result.worst.bound
    assert data.reached.values[scored].max() == result.worst.reached
    assert (out / "certificate.png").exists()


def test_a_tuned_run_is_certified_with_its_weights(tour):
    result = tour("check-bound-tuned").result(CertifiedResult)
    assert result.force == 1.0  # control_noise of the machine file
    assert all(row.reached <= row.bound for row in result.rows)


def test_no_attack_exceeds_a_bound_that_is_larger_than_the_part(simulated):
    loop = stored_loop(simulated)
    loop = replace(loop, controller=unlimited(loop.controller))
    machine = replace(promised(loop.machine), limits=MachineLimits())
    for one in certified_runs(loop, machine, Bounds(300.0, 0.5e-6)):
        assert one.row.bound > 8e-3
        assert np.all((one.reached <= one.certificate.bound)[one.certificate.scored])


def test_faults_are_told_in_a_line_and_nothing_is_written(simulated, tmp_path, capsys):
    out = tmp_path / "none"
    faults = {
        "force: a bound needs to be finite and at least zero, is -1.0": ("--force", "-1"),
        "encoder-um: rounding alone errs by half a count, 0.5 um": ("--encoder-um", "0.1"),
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


def test_a_control_beyond_the_limit_of_its_own_input_is_not_to_be_used():
    """Input 1 may have 10 A and input 2 only 3 A."""
    within = verdict_on([ROW, replace(ROW, control=(4.0, 1.0))], (10.0, 3.0), "A")
    assert within.exit_code == 0 and [one.value for one in within.limits] == [4.0, 2.5]
    beyond = verdict_on([ROW, replace(ROW, control=(4.0, 3.5), plant="early")], (10.0, 3.0), "A")
    assert beyond.exit_code == 3
    assert beyond.reasons[0] == "control of input 2 EXCEEDS its limit: 3.5 of 3 A (circle, early)"
    assert verdict_on([ROW], None, "A").limits == []
