import math

import pytest

from jcontour.app.files.design_files import DesignFiles
from jcontour.app.files.run_folder import RunError
from jcontour.app.runs.spread.predictive_runs import Ending, PredictiveRun

THIRD = PredictiveRun(Ending.ARRIVED, 1 / 3, 0.1, 1e-300, 0.5, 1e-17)


def test_results_load_back_in_the_same_bits_in_any_order(tmp_path):
    files = DesignFiles(tmp_path / "parts", PredictiveRun)
    files.add(7, PredictiveRun(Ending.UNSOLVED))
    files.add(2, THIRD)
    again = DesignFiles(tmp_path / "parts", PredictiveRun).found
    assert list(again) == [2, 7] and again[2] == THIRD
    assert again[7].ending is Ending.UNSOLVED and math.isnan(again[7].time_s)


def test_damaged_files_are_told_in_one_line(tmp_path):
    (tmp_path / "000000001.json").write_text("{")
    with pytest.raises(RunError, match="000000001.json: is not JSON"):
        DesignFiles(tmp_path, PredictiveRun)
    (tmp_path / "000000001.json").write_text('{"ending": "vanished"}')
    with pytest.raises(RunError, match="000000001.json: is not of this version's sweep"):
        DesignFiles(tmp_path, PredictiveRun)
