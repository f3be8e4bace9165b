"""First and last lines of every command."""

import shlex

import pytest

from jcontour.app.catalogue.own_classes import trust
from jcontour.app.cli import COMMANDS, _chosen
from jcontour.app.commands.loops.simulate import next_steps
from jcontour.app.files import run_folder
from jcontour.app.flags.loops import Simulate
from jcontour.app.flags.tuning import Rank, Tune
from jcontour.app.runs.lifecycle import (
    created,
    ranked_words,
    stored_flags,
    task_words,
    tuning_words,
)


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
    stored = run_folder.opened(folder, command)["flags"]
    assert task_words(stored["parts"], stored) == words


@pytest.mark.parametrize("kind", [kind for kind in COMMANDS if hasattr(kind, "out")])
def test_every_command_keeps_its_flags_in_a_folder_of_its_own(kind, tmp_path):
    command, _ = COMMANDS[kind]
    folder = created(kind(json=True, out=tmp_path / "run"), command)
    kept = stored_flags(folder, command, kind)
    assert not kept.json and kept.out is None


OWN = "mine.py:Proportional"


def parsed(line):
    """The flags that the command reads of a printed line."""
    command = line[line.index("jcontour ") :]
    return _chosen(shlex.split(command)[1:])[0]


@pytest.mark.parametrize(
    "given",
    [
        {"contour": "circle", "controller": OWN, "weights": ("gain=9000", "feedforward=-35")},
        {"contour": "my part.ngc", "plant": "gantry", "controller": "cascade", "preview": 20},
        {"alpha": 3.0, "beta": 1e9, "terminal": "riccati", "model_delay": 1, "feed_law": "jerk"},
    ],
)
def test_a_simulation_goes_on_with_its_part_machine_and_controller(given):
    [(_, line)] = next_steps(Simulate(**given))
    contour = given.pop("contour", None)
    assert parsed(line) == Tune(parts=() if contour is None else (contour,), **given)


def test_all_samples_of_a_run_are_not_a_preview_for_tuning():
    [(_, line)] = next_steps(Simulate(preview="path"))  # pyright: ignore[reportArgumentType]
    assert parsed(line) == Tune()


def test_words_of_a_stored_run_are_read_as_its_flags():
    stored = vars(Tune(controller=OWN)) | {"weights": ["gain=2"]}  # JSON has no tuples
    flags_read = parsed("jcontour tune" + tuning_words(["circle", "cam"], stored))
    assert flags_read == Tune(parts=("circle", "cam"), controller=OWN, weights=("gain=2",))


def test_a_controller_of_ones_own_is_ranked_beside_the_usual_one(tmp_path):
    (tmp_path / "mine.py").write_text("")
    own = f"{tmp_path / 'mine.py'}:Proportional"
    folder = created(Tune(parts=("circle",), controller=own, out=tmp_path / "run"), "tune")
    flags_read = parsed("jcontour rank" + ranked_words(folder))
    assert flags_read == Rank(parts=("circle",), controllers=("contouring-lq", own))
    of_ours = created(Tune(controller="preview-lq", out=tmp_path / "other"), "tune")
    assert parsed("jcontour rank" + ranked_words(of_ours)) == Rank()


def test_a_plant_without_a_usual_controller_is_ranked_with_the_own_one_alone(tmp_path):
    (tmp_path / "mine.py").write_text(PLANT)
    trust((tmp_path / "mine.py").read_bytes())
    own, plant = f"{tmp_path}/mine.py:Proportional", f"{tmp_path}/mine.py:Mass"
    folder = created(Tune(plant=plant, controller=own, out=tmp_path / "run"), "tune")
    assert parsed("jcontour rank" + ranked_words(folder)) == Rank(plant=plant, controllers=(own,))


PLANT = """
from tests.small_loops import Sliding

class Mass(Sliding):
    def measure(self, state):
        return state[0]
"""
