import json
import math
from dataclasses import dataclass

import numpy as np
import pytest

from jcontour.app.files.results.run_metrics import METRICS, RunMetrics
from jcontour.app.files.results.stored import (
    VERSION,
    Weight,
    from_json,
    read_result,
    to_json,
    write_result,
)
from jcontour.app.files.run_folder import RunError
from jcontour.simulation.metrics import Metrics
from tests.app import small_runs


@dataclass(frozen=True)
class Row:
    error: float
    limit: float | None
    name: str = "none"


@dataclass(frozen=True)
class Result:
    rows: tuple[Row, ...]
    weights: dict[str, Weight]
    gain: np.ndarray
    margins: dict[str, float]
    plants: list[str]
    usable: bool = True
    terminal: str | None = None


def made() -> Result:
    rows = (Row(np.float64(1e-6), None), Row(math.inf, 2.0, "last"))
    weights = {"alpha": 1.2, "stage": [1.0, 2.0], "beta": None}
    return Result(rows, weights, np.array([[1.0, math.nan]]), {"delay": 3.0}, ["nominal"])


def test_json_names_nulls_and_defaults():
    assert to_json(made()) == {
        "rows": [{"error": 1e-6, "limit": None}, {"error": None, "limit": 2.0, "name": "last"}],
        "weights": {"alpha": 1.2, "stage": [1.0, 2.0], "beta": None},
        "gain": [[1.0, None]],
        "margins": {"delay": 3.0},
        "plants": ["nominal"],
    }


def test_a_result_comes_back_to_the_last_bit(tmp_path):
    before = made()
    write_result(tmp_path, before)
    after = read_result(tmp_path, Result)
    assert after.rows[0] == before.rows[0] and math.isnan(after.rows[1].error)
    assert after.weights == before.weights and after.margins == before.margins
    np.testing.assert_array_equal(after.gain, before.gain)
    assert after.usable is True and after.terminal is None


@pytest.mark.parametrize(
    "change, words",
    [({"rows": None}, "rows"), ({"plants": [3]}, "plants"), ({"gain": "none"}, "gain")],
)
def test_a_result_of_another_form_is_refused_in_one_line(tmp_path, change, words):
    (tmp_path / "result.json").write_text(
        json.dumps({"version": VERSION} | to_json(made()) | change)
    )
    with pytest.raises(RunError, match=rf"not of this version's Result \(.*{words}"):
        read_result(tmp_path, Result)


def test_a_result_of_an_older_version_is_told(tmp_path):
    (tmp_path / "result.json").write_text(json.dumps(to_json(made())))
    with pytest.raises(RunError, match="of another version of jcontour; run it again"):
        read_result(tmp_path, Result)


def test_a_run_that_is_older_than_a_metric_has_nan_there():
    stored = to_json(small_runs.run_metrics(1.0))
    del stored["peak_increment"]
    known = from_json(stored, RunMetrics)
    assert math.isnan(known.peak_increment) and known.rms_increment == 1.0
    del stored["diverged"]
    with pytest.raises(ValueError, match="diverged"):
        from_json(stored, RunMetrics)


def test_metrics_of_the_library_and_of_the_files_are_the_same():
    assert list(METRICS) == list(Metrics.__dataclass_fields__)


def test_a_missing_field_is_named():
    values = to_json(made())
    del values["margins"]
    with pytest.raises(ValueError, match="required field missing @ result.margins"):
        from_json(values, Result)
