"""A tuned run of two contours, small, with text that tries to be markup."""

import json

import numpy as np
import pytest
import xarray as xr

from jcontour.app.files.netcdf import save_dataset
from jcontour.app.files.results.run_metrics import METRICS, MachineSummary
from jcontour.app.files.results.stored import to_json, write_result
from jcontour.app.files.results.tuned_result import HistoryPoint
from jcontour.app.files.results.verdict import Verdict, reason, warning

NASTY = "</script><img src=x onerror=alert(1)>@PLOTS@"


def dataset(steps=900, designs=("start", "tuned"), plants=("nominal", NASTY), length=700):
    """Rollouts of a circle whose second contour is shorter."""
    random = np.random.default_rng(0)
    angle = np.linspace(0, 2 * np.pi, steps)
    circle = 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    reference = np.stack([circle, circle])
    reference[1, length:] = reference[1, length - 1]
    shape = (len(designs), 2, len(plants), steps)
    error = (
        1e-6 * random.normal(size=(*shape, 2)) * np.array([20.0, 5.0])[:, None, None, None, None]
    )
    error[1, 0, 1, 437] = [9e-5, 0.0]  # the only peak
    runs = ("design", "contour", "plant")
    signal = (*runs, "time", "axis")
    data = {
        "output": (signal, reference[None, :, None] + error),
        "contour_error": (signal, error),
        "control": ((*runs, "time", "input"), random.normal(size=(*shape, 2))),
        "reference": (("contour", "time", "axis"), reference),
        "scored": (("contour", "time"), np.zeros((2, steps), "i1")),
        "training": (("contour",), np.array([1, 0], "i1")),
        "diverged": (runs, np.zeros(shape[:3], "i1")),
    }
    data |= {name: (runs, random.uniform(1e-6, 1e-4, shape[:3])) for name in METRICS}
    coordinates = {
        "design": list(designs),
        "contour": ["circle", "short"],
        "plant": list(plants),
        "time": 1e-3 * np.arange(steps),
        "axis": ["X", "Y"],
        "input": ["u1", "u2"],
    }
    return xr.Dataset(data, coordinates)


def write_run(folder, data=None):
    """Folder of a tuned run, as `tune` leaves it."""
    folder.mkdir(parents=True)
    settings = {
        "command": "tune",
        "command_line": ["jcontour", "tune", "my part.ngc", NASTY, "--out", "runs/a"],
        "flags": {"plant": NASTY, "parts": ["my part.ngc"]},
        "versions": {"python": "3"},
    }
    from tests.app import small_runs  # computes: not before the tests are set up

    result = small_runs.tuned_result(
        machine=MachineSummary(NASTY, "V", ("X", "Y"), "counts"),
        verdict=Verdict.of([], [reason(NASTY), warning("it hums")]),
        weight_lines=["alpha  1"],
        limits={"peak_sensitivity": 2.0},
    )
    points = [
        HistoryPoint(
            descent=0,
            weights={"alpha": 1.0 + k},
            objective=1e-5 / (1 + k),
            violation=0.0 if k < 3 else 1.0,
            diverged=False,
            rms_error=1e-5 / (1 + k),
            rms_increment=0.1 * (1 + k),
        )
        for k in range(4)
    ]
    for name, value in (("settings", settings), ("history", to_json(points))):
        (folder / f"{name}.json").write_text(json.dumps(value))
    write_result(folder, result)
    save_dataset(dataset() if data is None else data, folder / "rollouts.nc")
    frequency, sensitivity = np.geomspace(1, 500, 30), np.ones((2, 2, 30))
    curves = xr.Dataset(
        {"sensitivity": (("design", "plant", "frequency"), sensitivity)},
        {"design": ["start", "tuned"], "frequency": frequency},
    )
    save_dataset(curves, folder / "sensitivity.nc")
    return folder


@pytest.fixture(scope="module")
def nasty():
    return NASTY


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("page") / "run-1")


@pytest.fixture
def long_run(tmp_path):
    return write_run(tmp_path / "long", dataset(steps=40_000, length=30_000))
