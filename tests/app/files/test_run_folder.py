import json
import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from jcontour.app.files import run_folder

FULL = Path("/dev/full")


@dataclass(frozen=True)
class Flags:
    seed: int = 3


def test_a_run_folder_is_made_once(tmp_path):
    folder = run_folder.create(tmp_path / "run", "tune", Flags(), [])
    assert run_folder.opened(folder, "tune")["flags"] == {"seed": 3}
    with pytest.raises(run_folder.RunError, match="already holds something"):
        run_folder.create(folder, "tune", Flags(), [])
    assert list(tmp_path.iterdir()) == [folder]


def test_a_run_of_another_command_or_version_is_told(tmp_path):
    folder = run_folder.create(tmp_path / "run", "tune", Flags(), [])
    with pytest.raises(run_folder.RunError, match="holds a run of 'tune', not of 'front'"):
        run_folder.opened(folder, "front")
    (folder / run_folder.SETTINGS).write_text('{"command": "tune"}')
    with pytest.raises(run_folder.RunError, match="a run of another version of jcontour"):
        run_folder.opened(folder, "tune")


def test_a_file_that_is_no_json_or_never_ends_is_told(tmp_path):
    (tmp_path / "deep.json").write_text("[" * 100_000)
    os.mkfifo(tmp_path / "pipe.json")  # nothing ever writes into it
    for name, words in (("deep.json", "is not JSON"), ("pipe.json", "not a regular file")):
        with pytest.raises(run_folder.RunError, match=words):
            run_folder.read_json(tmp_path, name)


def test_an_empty_folder_is_taken(tmp_path):
    (tmp_path / "run").mkdir()
    assert run_folder.create(tmp_path / "run", "tune", Flags(), []).is_dir()


def test_of_many_at_once_one_wins(tmp_path):
    def attempt(_):
        try:
            run_folder.create(tmp_path / "run", "tune", Flags(), [])
            return True
        except run_folder.RunError:
            return False

    with ThreadPoolExecutor(8) as pool:
        assert sum(pool.map(attempt, range(16))) == 1


def test_inputs_are_copied(tmp_path):
    part = tmp_path / "part.ngc"
    part.write_text("G1 X1 F1")
    folder = run_folder.create(tmp_path / "run", "tune", Flags(), [part])
    copy = run_folder.opened(folder, "tune")["inputs"][str(part)]
    assert (folder / copy).read_text() == "G1 X1 F1"


def test_a_failed_write_leaves_what_was_there(tmp_path):
    path = run_folder.write_json(tmp_path / "a.json", {"a": 1})

    def fail(temporary):
        temporary.write_text("half")
        raise OSError("disk full")

    with pytest.raises(run_folder.RunError, match="disk full"):
        run_folder.write(path, fail)
    assert json.loads(path.read_text()) == {"a": 1} and list(tmp_path.iterdir()) == [path]


def test_json_of_numpy_and_infinities():
    assert json.loads(
        run_folder.json_text(
            {"a": np.float64(0.1), "b": np.arange(2), "c": math.inf, "d": (True, None)}
        )
    ) == {
        "a": 0.1,
        "b": [0, 1],
        "c": None,
        "d": [True, None],
    }


def test_two_at_work_on_one_run(tmp_path):
    folder = run_folder.create(tmp_path / "run", "tune", Flags(), [])
    with (
        run_folder.locked(folder),
        pytest.raises(run_folder.RunError, match="another process"),
        run_folder.locked(folder),
    ):
        pass


@pytest.mark.skipif(not FULL.exists(), reason="no device stands for a full disk here")
def test_a_full_disk_is_told_with_the_path(tmp_path):
    with pytest.raises(run_folder.RunError, match=r"log\.csv: cannot be written \(No space left"):
        run_folder.write(tmp_path / "log.csv", lambda temporary: FULL.write_text("0"))
    assert list(tmp_path.iterdir()) == []
