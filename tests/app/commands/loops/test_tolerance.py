"""`tolerance` from the command line: kept within the bounds, refused in one line."""

import re

import numpy as np
import pytest

from jcontour.app.cli import main
from jcontour.app.files.netcdf import load_dataset
from jcontour.app.files.results.bound_results import ToleranceResult
from jcontour.app.files.results.stored import read_result


@pytest.fixture
def kept(tour):
    assert tour("tolerance").code == 3  # acceleration
    return tour("tolerance").folder


def test_within_the_bounds_the_tolerance_and_the_limits_are_kept(kept):
    result, data = read_result(kept, ToleranceResult), load_dataset(kept / "runs.nc")
    assert result.length == 8 and result.force == 0.5 and result.encoder == 0.5e-6
    assert sum(result.shares.values()) < result.promised < 1.05 * sum(result.shares.values())
    within = [k for k, run in enumerate(result.runs) if run.within]
    assert len(within) == 3 and all(result.runs[k].keeps(result.promised) for k in within)
    for k in within:
        run = result.runs[k]
        assert 0 < run.largest <= result.promised and run.fallbacks == 0 and run.left is None
        assert np.nanmax(data.error.values[k]) >= run.largest
        np.testing.assert_array_equal(np.abs(data.control.values[k]).max(axis=0), run.control)
        assert np.all(np.array(run.control) <= result.control_limit)
        assert run.residual < 1e-8
    assert result.runs[0].largest > 0.2 * result.promised  # the attack is one
    late = next(run for run in result.runs if "late" in run.plant)
    assert late.left is not None and not late.within
    assert (kept / "tolerance.png").exists()


def test_an_acceleration_beyond_the_limit_is_warned_of_in_the_runs(kept):
    """The machine allows 4 m/s^2. At the samples the late one alone takes more.

    Between them those within the bounds do too, their control alternates; they are told first.
    """
    result, data = read_result(kept, ToleranceResult), load_dataset(kept / "runs.nc")
    dt = float(data.time.values[1])
    sampled = np.abs(np.diff(data.output.values, n=2, axis=1)).max(axis=1) / dt**2
    late = next(k for k, run in enumerate(result.runs) if "late" in run.plant)
    assert (sampled[:late] < 4).all() and (sampled[late] > 4).all()
    x, y = (line for line in result.verdict.reasons if line.startswith("acceleration"))
    told = r"EXCEEDS its limit: (\S+) of 4 m/s\^2, (\S+) of it between samples: .+ \((.+)\)"
    for axis, line in enumerate((x, y)):
        whole, hidden, place = re.search(told, line).groups()
        names = [f"{result.contour}, {run.plant}, {run.disturbance}" for run in result.runs]
        k = names.index(place)
        assert k < late
        assert float(whole) - float(hidden) == pytest.approx(sampled[k, axis], abs=0.01)
    assert "does not know those of acceleration" in result.verdict.reasons[-1]


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        ("--tolerance-um -1", "tolerance-um: needs to be above zero"),
        ("--tolerance-um nan", "tolerance-um: needs a finite number"),
        ("--length 0", "length: needs 1 to 100 samples"),
        ("--length 8 --force 1000", "force: 1000 .* leaves nothing .*: speed of X in m/s: "),
        ("--length 8 --tolerance-um 0.1", "tolerance-um: 0.1 um cannot be promised on"),
        ("--plant gantry", "plant: gantry is not linear"),
        ("--plant bridgeport --solver nothing", "solver"),
    ],
)
def test_bad_input_is_one_line(flags, told, machine_file, part_file, tmp_path, capsys):
    machine = [] if "--plant" in flags else ["--plant", str(machine_file)]
    out = tmp_path / "run"
    code = main(["tolerance", str(part_file), *machine, *flags.split(), "--out", str(out)])
    lines = capsys.readouterr().err.strip().splitlines()
    assert code == 2 and len(lines) == 1 and not out.exists()
    assert re.search(told, lines[0]), lines[0]


def test_simulate_says_which_command_runs_it(capsys):
    assert main(["simulate", "--controller", "bounded-mpc"]) == 2
    assert "run it with `jcontour tolerance`" in capsys.readouterr().err
