import json

import pytest

from experiments.commands.compare import run
from experiments.files.run_folder import RESULT, SETTINGS, RunError
from experiments.reports.tables import COLUMNS


def stored(folder, alpha, value, command="tune", error="contour"):
    folder.mkdir()
    metrics = {name: value for name, _, _ in COLUMNS}
    contour = {
        "name": "circle",
        "training": True,
        "metrics": {"tuned": {"nominal": metrics, "worst": metrics}},
    }
    result = {
        "error": error,
        "weights": {"alpha": alpha, "beta": 1.0, "rho": 2e-9},
        "contours": [contour],
        "safety": {"largest_frozen_spectral_radius": 0.9, "delay_samples": 2},
    }
    (folder / SETTINGS).write_text(
        json.dumps(
            {"command": command, "flags": {"seed": int(alpha), "out": str(folder)}, "versions": {}}
        )
    )
    (folder / RESULT).write_text(json.dumps(result))
    return folder


def test_what_changed_and_which_is_better(tmp_path):
    summary = run(stored(tmp_path / "a", 1.0, 1e-6), stored(tmp_path / "b", 2.0, 2e-6))
    assert summary["settings"] == {"seed": [1, 2]} and summary["weights"]["alpha"] == [1.0, 2.0]
    assert summary["better"] == {"first": 2 * len(COLUMNS), "second": 0, "same": 0}


def test_equal_runs(tmp_path):
    summary = run(stored(tmp_path / "a", 1.0, 1e-6), stored(tmp_path / "b", 1.0, 1e-6))
    assert summary["settings"] == {} and summary["better"]["same"] == 2 * len(COLUMNS)


def test_a_single_axis_has_no_contour_error(tmp_path):
    summary = run(
        *(
            stored(tmp_path / name, 1.0, value, error="tracking")
            for name, value in (("a", 1e-6), ("b", 2e-6))
        )
    )
    assert [row["metric"] for row in summary["metrics"]] == 2 * [
        name for name, _, _ in COLUMNS if "contour" not in name
    ]
    assert summary["better"] == {"first": 8, "second": 0, "same": 0}


def test_not_a_run(tmp_path):
    with pytest.raises(RunError, match="not a run folder"):
        run(stored(tmp_path / "a", 1.0, 1e-6), tmp_path / "none")
    with pytest.raises(RunError, match="not of 'tune'"):
        run(
            stored(tmp_path / "b", 1.0, 1e-6), stored(tmp_path / "c", 1.0, 1e-6, command="simulate")
        )
