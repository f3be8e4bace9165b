"""`check` under limits from the command line."""

import shlex
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from rich.console import Console

from jcontour.app.catalogue.choices import machine_named
from jcontour.app.cli import _chosen, main
from jcontour.app.commands.loops.check import (
    GapRow,
    Verified,
    _answer,
    limits_of,
    show,
    verdict_on,
)
from jcontour.app.files.results.verdict import Verdict, reason
from jcontour.app.flags.loops import Check
from jcontour.app.machines.machine import MachineLimits
from tests.app.small_runs import run_metrics


def test_what_limits_cost(tour):
    visit = tour("check")
    out, gaps = visit.folder, visit.stored()["gaps"]
    assert visit.code == (0 if visit.stored()["verdict"]["usable"] else 3)
    assert any(gap["active_fraction"] > 0 for gap in gaps)
    assert all(gap["residual"] <= 1e-8 for gap in gaps)
    assert visit.result(Verified).gaps[0].contour == gaps[0]["contour"]
    stored = sorted(out.glob("run-*.nc"))
    assert len(stored) == len(gaps)
    assert all(max(gap["reached"]["increment"]) <= 5 * (1 + 1e-9) for gap in gaps)
    assert all(
        set(gap["reached"]) == {"control", "increment", "speed", "acceleration"} for gap in gaps
    )
    assert np.abs(np.diff(xr.load_dataset(stored[0]).control.values, axis=0)).max() <= 5 * (
        1 + 1e-9
    )


def test_it_needs_a_run(tmp_path, capsys):
    assert main(["check", str(tmp_path)]) == 2
    assert "settings.json" in capsys.readouterr().err


def test_limits_of_the_machine_and_of_the_flags(machine_file):
    machine = machine_named(str(machine_file))
    own = limits_of(Check(), machine)
    changed = limits_of(Check(max_control=7.0, max_speed_mm_per_min=3000.0), machine)
    assert own.speed[1].tolist() == [0.2, 0.2]
    assert changed.speed[1] == 0.05 and changed.control[1] == 7.0
    assert changed.increment[1].tolist() == own.increment[1].tolist()
    with pytest.raises(ValueError, match="max-control"):
        limits_of(Check(max_control=-1.0), machine)


def test_the_default_machine_states_a_limit_and_one_without_is_told():
    machine = machine_named("bridgeport")
    assert limits_of(Check(), machine).control[1].tolist() == [10.0, 10.0]
    with pytest.raises(ValueError, match="bridgeport states no limits; give --max-control"):
        limits_of(Check(), replace(machine, limits=MachineLimits()))


def row(without, within, active=0.5, failure="", reached=None):
    """A row whose RMS contour errors are given [m]."""
    most = {} if reached is None else reached
    limited = None if within is None else run_metrics(0.0, rms_contour_error=within)
    tuned = run_metrics(0.0, rms_contour_error=without)
    return GapRow("circle", "nominal", active, 0.1, 1e-12, 0, None, failure, most, tuned, limited)


GOOD = Verdict.of([])
ASKED = {"control": None, "acceleration": [[-4.0, -2.0], [4.0, 2.0]], "speed": [-1.0, 1.0]}


def test_a_limit_that_a_machine_exceeds_is_told_loudly():
    kept = row(1e-6, 1e-6, reached={"acceleration": [4.001, 1.0], "speed": [0.5, 0.1]})
    over = replace(kept, plant="late", reached={"acceleration": [3.0, 5.0], "speed": [0.5, 0.1]})
    verdict = verdict_on([kept, over], ASKED, "V")
    assert verdict.exit_code == 3
    assert verdict.reasons[0] == "acceleration EXCEEDS its limit: 5 of 2 m/s^2 (circle, late)"
    text = printed(Verified("runs/a", GOOD, {}, "daqp", ASKED, [kept, over], "V", verdict))
    assert "4.001 of 4" in text and "30000 of 60000" in text and "mm/min" in text
    within = verdict_on([kept], ASKED, "V")
    assert within.exit_code == 0 and within.reasons == []
    unstable = verdict_on([kept], ASKED, "V", [reason("unstable")])
    assert unstable.exit_code == 3 and unstable.reasons == ["unstable"]
    stopped = verdict_on([replace(kept, failure="step 3: infeasible")], ASKED, "V")
    assert stopped.exit_code == 3 and "step 3: infeasible" in stopped.reasons[0]


@pytest.mark.parametrize(
    ("row", "line"),
    [
        (row(1e-6, 2e-6, reached={"acceleration": [5.0, 1.0]}), "tune cam --acceleration 1.44"),
        (
            row(1e-6, 2e-6, reached={"control": [4.0]}),
            "tune cam --acceleration 2.0 --max-peak-control 9.0",
        ),
        (row(1e-6, None, failure="step 3"), "check 'my runs/a' --max-control 10.0 --fallback soft"),
        (row(1e-6, 1e-6, active=0.0), "export 'my runs/a'"),
    ],
)
def test_the_next_step_is_a_command(row, line):
    """2 m/s^2 times 4 / 5, and a tenth less; nine tenths of 10 V; soft limits; the code."""
    verdict = verdict_on([row], ASKED | {"control": [-10.0, 10.0]}, "V")
    flags = Check(run=Path("my runs/a"), max_control=10.0)
    *_, entry = _answer([row], verdict, flags, {"parts": ["cam"], "acceleration": 2.0})
    assert entry == ("Next", f"jcontour {line}")
    _chosen(shlex.split(line))


def printed(result):
    text = StringIO()
    show(result, Console(file=text, width=80))
    return text.getvalue()
