import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pytest

from experiments import runs


@dataclass(frozen=True)
class Flags:
    seed: int = 3


def test_a_run_folder_is_made_once(tmp_path):
    folder = runs.create(tmp_path / "run", "tune", Flags(), [])
    assert runs.opened(folder, "tune")["flags"] == {"seed": 3}
    with pytest.raises(runs.RunError, match="already holds another run"):
        runs.create(folder, "tune", Flags(), [])
    assert list(tmp_path.iterdir()) == [folder]


def test_an_empty_folder_is_taken(tmp_path):
    (tmp_path / "run").mkdir()
    assert runs.create(tmp_path / "run", "tune", Flags(), []).is_dir()


def test_of_many_at_once_one_wins(tmp_path):
    def attempt(_):
        try:
            runs.create(tmp_path / "run", "tune", Flags(), [])
            return True
        except runs.RunError:
            return False

    with ThreadPoolExecutor(8) as pool:
        assert sum(pool.map(attempt, range(16))) == 1


def test_inputs_are_copied(tmp_path):
    part = tmp_path / "part.ngc"
    part.write_text("G1 X1 F1")
    folder = runs.create(tmp_path / "run", "tune", Flags(), [part])
    copy = runs.opened(folder, "tune")["inputs"][str(part)]
    assert (folder / copy).read_text() == "G1 X1 F1"


def test_a_failed_write_leaves_what_was_there(tmp_path):
    path = runs.write_json(tmp_path / "a.json", {"a": 1})

    def fail(temporary):
        temporary.write_text("half")
        raise OSError("disk full")

    with pytest.raises(OSError):
        runs.write(path, fail)
    assert json.loads(path.read_text()) == {"a": 1} and list(tmp_path.iterdir()) == [path]


def test_json_of_numpy_and_infinities():
    assert json.loads(runs.json_text({"a": np.float64(0.1), "b": np.arange(2), "c": math.inf, "d": (True, None)})) == {
        "a": 0.1, "b": [0, 1], "c": None, "d": [True, None],
    }  # fmt: skip


def test_two_at_work_on_one_run(tmp_path):
    folder = runs.create(tmp_path / "run", "tune", Flags(), [])
    with runs.locked(folder), pytest.raises(runs.RunError, match="another process"), runs.locked(folder):
        pass
