""""""

import base64
import json

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from jcontour.app.files.results.tuned_result import DriveLoop, HistoryPoint, TunedContour
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.files.run_folder import RunError
from jcontour.app.flags.tuning import Tune
from jcontour.app.reports.page.page_data import (
    StoredRun,
    _alternatives,
    _changed,
    kept_samples,
    packed,
    page_data,
)
from tests.app import small_runs


@given(st.integers(0, 1000), st.integers(1, 4), st.integers(10, 5000))
def test_every_peak_stays_and_few_others_do(seed, count, steps):
    signals = np.abs(np.random.default_rng(seed).normal(size=(count, steps)))
    kept = kept_samples(signals, 400)
    assert kept[0] == 0 and kept[-1] == steps - 1 and np.all(np.diff(kept) > 0)
    assert len(kept) <= 402
    assert np.array_equal(signals[:, kept].max(axis=1), signals.max(axis=1))


def test_short_runs_stay_whole_and_nan_is_no_peak():
    assert kept_samples(np.ones((1, 7)), 7).tolist() == list(range(7))
    signal = np.full((1, 1000), np.nan)
    signal[0, 333] = 1.0
    assert 333 in kept_samples(signal, 20)


def test_packed_numbers_read_back():
    values = np.array([[1.5, np.nan], [-2e-9, 4e20]])
    read = np.frombuffer(base64.b64decode(packed(values)["f32"]), "<f4")
    assert np.array_equal(read, values.astype(np.float32).ravel(), equal_nan=True)


def numbers(packed, *shape):
    return np.frombuffer(base64.b64decode(packed["f32"]), "<f4").reshape(shape)


@pytest.fixture(scope="module")
def data(run_folder):
    return page_data(run_folder)


def test_signals_are_those_of_the_folder(data, run_folder):
    stored = xr.load_dataset(run_folder / "rollouts.nc")
    one = data["contours"][0]
    assert one["samples"] == one["kept"] == 900
    error = numbers(one["error"], 2, 2, 900, 2)
    assert np.allclose(error, 1e6 * stored.contour_error.values[:, 0], rtol=1e-6)
    feed = numbers(one["feed"], 2, 2, 900)
    moved = np.linalg.norm(np.diff(stored.output.values[:, 0], axis=2), axis=-1)
    assert np.allclose(feed[..., 1:], 60e3 * moved / 1e-3, rtol=1e-5)
    arc = numbers(one["arc"], 900)
    assert arc[0] == 0 and arc[-1] == pytest.approx(100 * np.pi, rel=1e-4)  # [mm], radius 50


def test_padding_is_left_out_and_held_out_is_told(data):
    assert [one["samples"] for one in data["contours"]] == [900, 700]
    assert [one["training"] for one in data["contours"]] == [True, False]


def test_a_small_room_thins_and_keeps_the_peak(run_folder):
    one = page_data(run_folder, room=1.0)["contours"][0]
    assert one["kept"] < 400
    error = numbers(one["error"], 2, 2, one["kept"], 2)
    assert error[1, 1, :, 0].max() == pytest.approx(90.0)


def test_points_are_those_of_the_history(data):
    points = data["points"]["points"]
    assert [one["feasible"] for one in points] == [True, True, True, False]
    assert points[1] == {
        "x": 0.2,
        "y": 5.0,
        "feasible": True,
        "recommended": False,  # the verdict is against the run
        "design": None,
        "weights": {"alpha": 2.0},
    }


def test_settings_are_those_that_differ_from_their_defaults():
    flags = {"plant": "mill", "steps": 15, "parts": ["a.ngc", "b.ngc"], "nominal_only": True}
    found = _changed(Tune, flags)
    assert found == {"plant": "mill", "parts": "a.ngc b.ngc", "nominal_only": "yes"}


def test_alternatives_stand_side_by_side_and_one_is_recommended():
    metrics = {"start": small_runs.family_metrics(4e-6), "tuned": small_runs.family_metrics(1e-6)}
    one = TunedContour(name="part", training=True, samples=9, metrics=metrics)
    drive = DriveLoop(
        controller="p", weights={}, error=3e-6, tuned_error=1e-6, kept=True, sensitivity=1.9
    )
    given = {"contours": [one], "drive": drive, "margins": small_runs.margins(sensitivity=1.6)}
    tried = [  # weights, objective, increment: less error with more change of the control
        HistoryPoint(0, {"rho": 1.0}, 1e-6, 0.0, False, 1e-6, 8.0),
        HistoryPoint(0, {"rho": 2.0}, 3e-6, 0.0, False, 3e-6, 3.0),
        HistoryPoint(0, {"rho": 3.0}, 2e-6, 0.0, False, 2e-6, 4.0, 1.3),
        HistoryPoint(0, {"rho": 4.0}, 1e-6, 1.0, False, 1e-6, 4.0),  # beyond a limit
        HistoryPoint(0, {"rho": 5.0}, 5e-6, 0.0, False, 5e-6, 1.0),
    ]
    result = small_runs.tuned_result(**given, weights={"rho": 1.0}, verdict=Verdict.of([]))
    start, tuned, half, quarter, simple = _alternatives(result, tried)
    errors = [row["error"] for row in (start, tuned, half, quarter, simple)]
    assert errors == pytest.approx([4.0, 1.0, 2.0, 5.0, 3.0])
    assert [half["effort"], quarter["effort"]] == pytest.approx(
        [tuned["effort"] / 2, tuned["effort"] / 8]
    )
    assert [row["margin"] for row in (tuned, half, simple)] == [1.6, 1.3, 1.9]
    assert "recommended" in tuned["note"] and not start["note"]
    assert "--weights rho=3" in half["note"]


def test_a_notebook_shows_the_screen_and_no_markup_of_the_user(run_folder):
    shown = StoredRun(run_folder)._repr_html_()
    assert shown.startswith("<pre>DO NOT USE") and "it hums" in shown
    assert "<img" not in shown


def test_a_run_without_signals_has_a_page(run_folder, tmp_path):
    folder = tmp_path / "bare"
    folder.mkdir()
    for name in ("settings", "result"):
        (folder / f"{name}.json").write_text((run_folder / f"{name}.json").read_text())
    found = page_data(folder)
    assert found["contours"] == [] and found["sensitivity"] is None and found["points"] is None


def test_other_folders_are_told_in_a_line(run_folder, tmp_path):
    with pytest.raises(RunError, match="is not a run folder"):
        page_data(tmp_path)
    (tmp_path / "settings.json").write_text('{"command": "check"}')
    with pytest.raises(RunError, match="'check'; pages are made of tune, simulate, audit, front"):
        page_data(tmp_path)
    settings = json.loads((run_folder / "settings.json").read_text())
    (tmp_path / "settings.json").write_text(json.dumps(settings))
    result = json.loads((run_folder / "result.json").read_text())
    for older in ({}, {name: value for name, value in result.items() if name != "verdict"}):
        (tmp_path / "result.json").write_text(json.dumps(older))
        with pytest.raises(RunError, match="of another version of jcontour|not of this version"):
            page_data(tmp_path)
