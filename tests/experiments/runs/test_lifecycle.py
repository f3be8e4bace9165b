"""First and last lines of every command."""

from pathlib import Path

import pytest

from experiments.flags.tuning import Rank, Tune
from experiments.runs.lifecycle import created, same_task


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (Tune(), ""),
        (Tune(plant="gantry", seed=3, max_sensitivity=1.7), " --plant gantry"),
        (
            Rank(parts=("cam", "square"), feed_mm_per_min=1200.0, acceleration=1.5),
            " cam square --feed-mm-per-min 1200.0 --acceleration 1.5",
        ),
    ],
)
def test_parts_machine_and_pace_are_told_again(flags, words, tmp_path):
    command = type(flags).__name__.lower()
    folder = created(flags.__class__(**{**vars(flags), "out": tmp_path / "run"}), command)
    assert same_task(folder, command) == words


def test_names_with_spaces_are_quoted(tmp_path):
    part = tmp_path / "my part.csv"
    part.write_text("0,0\n1,0\n")
    folder = created(Tune(parts=(str(part),), out=tmp_path / "run"), "tune")
    assert same_task(folder, "tune") == f" '{Path(part)}'"
