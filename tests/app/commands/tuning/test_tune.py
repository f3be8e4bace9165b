"""One whole `jcontour tune` on a tiny machine."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from jcontour.app.commands.tuning import tune
from jcontour.app.commands.tuning.tune import next_steps
from jcontour.app.files.results.tuned_result import TunedResult
from jcontour.app.files.results.verdict import Verdict, reason
from jcontour.app.flags.tuning import Tune
from jcontour.app.machines.machine import Machine
from jcontour.app.reports.tables import console_of
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.app.runs.tuning.searching import NothingSound
from tests.app.small_runs import partly
from tuning.problem import QUICK

FILES = {
    "result.json", "settings.json", "history.json", "state.npz", "rollouts.nc", "gains.csv",
    "observer.json", "contour-part.png", "errors-part.png",
}  # fmt: skip


@pytest.fixture
def tuned(tour):
    return tour("tune").folder


@pytest.fixture
def result(tour):
    return tour("tune").result(TunedResult)


def test_its_files_are_there(tuned):
    assert FILES <= {path.name for path in tuned.iterdir()}


def test_tuned_weights_are_better_on_what_was_tuned(tuned, result):
    """Objective and metrics agree with the rollouts, computed again from the signals."""
    contours = {one.name: one for one in result.contours}
    part = contours["part"]
    assert list(contours) == ["part", "circle", "ellipse", "lemniscate", "square"]
    assert [one.training for one in contours.values()] == [True, *4 * [False]]
    before, after = part.metrics["start"].worst, part.metrics["tuned"].worst
    assert after.rms_contour_error < before.rms_contour_error
    with_signals = xr.load_dataset(tuned / "rollouts.nc").sel(contour="part", design="tuned")
    counted = with_signals.scored.values.astype(bool)
    size = np.linalg.norm(with_signals.contour_error.values, axis=-1)[:, counted]
    rms = np.sqrt(np.mean(size**2, axis=-1))
    np.testing.assert_allclose(rms[0], part.metrics["tuned"].nominal.rms_contour_error, rtol=1e-9)
    np.testing.assert_allclose(rms.max(), after.rms_contour_error, rtol=1e-9)
    assert result.margins.stable and result.margins.sensitivity < 2.0 * (1 + 1e-5)
    assert result.robust.diverged == 0
    assert result.verdict.usable and result.verdict.reasons == []


def test_where_the_peak_is(tuned, result, part_file):
    """The place is on the line of the program that is named, or on a blend at its end."""
    part = next(one for one in result.contours if one.name == "part")
    peak, worst = part.peak, part.metrics["tuned"].worst
    assert peak is not None and peak.plant in result.plants
    assert peak.error == pytest.approx(worst.peak_contour_error, rel=1e-9)
    line = part_file.read_text().splitlines()[peak.line - 1]
    x, y = 1e3 * np.array(peak.position)
    on_line = {
        "G1 X2 F3000": abs(y),
        "G3 X2 Y2 I0 J1": abs(np.hypot(x - 2, y - 1) - 1),
        "G1 X0": abs(y - 2),
        "G1 Y0": abs(x),
    }
    assert on_line[line] < 2e-3  # [mm] that corners are blended within


def test_the_history_holds_every_point(tuned, result):
    points = json.loads((tuned / "history.json").read_text())
    assert len(points) == result.evaluated_points
    used = {"speed_use": 1.0, "acceleration_use": 1.0, "control_use": 0.97, "increment_use": 0.97}
    lag = result.limits["rms_tracking_error"]  # 5 samples at the highest speed
    limits = {"rms_tracking_error": lag, "peak_sensitivity": 2.0, "count_noise": 0.8 * 3, **used}
    assert result.limits == pytest.approx(limits)
    assert 0.8 * 5 * 0.05 * 2e-3 < lag <= 5 * 0.05 * 2e-3  # the part is too short for its feed
    kept = [one for one in points if not one["diverged"] and not one["violation"] > 1e-6]
    assert min(kept, key=lambda one: one["objective"])["weights"] == result.weights


def test_files_that_a_drive_loads_are_there_and_named(tuned, result):
    assert set(result.files) == {"gains*.csv", "observer.json"}
    for pattern in result.files:
        assert list(tuned.glob(pattern)), pattern
    load, then = next_steps(replace(result, verdict=Verdict.of([])), tuned)
    assert load == ("To load", "gains*.csv, observer.json, in the folder below")
    assert then == ("Next", f"jcontour check {tuned} --bound")
    assert next_steps(replace(result, verdict=Verdict.of([], [reason("late")])), tuned) == []


@pytest.mark.parametrize(
    ("lost", "told"),
    [(["the control is NaN"], "with the start, the control is NaN"), ([], "every start diverges")],
)
def test_a_search_without_a_result_says_whether_numbers_are_lost(lost, told, tmp_path, monkeypatch):
    """A control that is no number is not told as a loop that is unstable."""

    def nothing(*_):
        raise NothingSound("every start diverges")

    monkeypatch.setattr(tune, "searched", nothing)
    monkeypatch.setattr(tune, "lost_at_start", lambda run: lost)
    machine = partly(Machine, error="contour")
    run = partly(TuningRun, settings=QUICK, machine=machine, flags=Tune())
    with pytest.raises(RuntimeError, match=f"no result: {told}; the points tried are kept in"):
        tune._descended(run, tmp_path, console_of(quiet=True))
