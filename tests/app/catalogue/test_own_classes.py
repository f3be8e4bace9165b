"""Controllers and plants from files of the user's: what runs, and what is refused in one line."""

import importlib
import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from jcontour.app.catalogue import own_classes
from jcontour.app.catalogue.choices import design_for, machine_named
from jcontour.app.catalogue.own_classes import UntrustedCodeError, own_name, trust, trust_named
from jcontour.app.cli import main
from jcontour.app.files import run_folder
from jcontour.app.flags.loops import Export, Simulate
from jcontour.app.flags.tuning import Tune
from jcontour.app.runs.lifecycle import created, resumed

ROOT = Path(__file__).parents[3]
CONTROLLERS = """
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jcontour.app.designs.flexible_axis import AxisCascade
from jcontour.controller import Controller
from tuning import Interval, Weight

print("loaded")

class PD(Controller):
    gain: float = 100.0
    limit: float = float("inf")
    samples: int = 3
    preview: int = eqx.field(static=True, default=0)

    @classmethod
    def by_model(cls, model):
        return cls(gain=1.0 / model.dt)

    def prepare(self, reference):
        return reference.position[: reference.steps]

    def initial_memory(self, reference):
        return None

    def step(self, memory, plan, measurement):
        return memory, self.gain * (plan - measurement)

class Looking(PD):
    weights = (Weight("gain", "A/m", Interval(1.0, 5e3)),)

    @classmethod
    def for_model(cls, model, preview):
        return cls(gain=1.0 / model.dt, preview=preview)

class Slow(AxisCascade):
    "A position loop that begins slowly."

    weights = (*AxisCascade.weights, Weight("position", "1/s", start=3.0))

class Misnamed(PD):
    weights = (Weight("gains"),)

class Open(PD):
    gain: int = 1

class PerAxis(PD):
    gain: jax.Array = eqx.field(default_factory=lambda: jnp.array([100.0, 200.0]))

class Needy(PD):
    name: str = eqx.field(static=True, kw_only=True)

class Broken(PD):
    def step(self, memory, plan, measurement):
        return memory, 1 / 0

class OneNumber(PD):
    def step(self, memory, plan, measurement):
        return memory, measurement[:1]

class Deciding(PD):
    def step(self, memory, plan, measurement):
        return memory, plan if plan[0] > 0 else measurement

class NumPy(PD):
    def step(self, memory, plan, measurement):
        return memory, np.asarray(measurement)

class Indexing(PD):
    def step(self, memory, plan, measurement):
        return memory, [plan, measurement][jnp.argmax(plan)]

class Converting(PD):
    def step(self, memory, plan, measurement):
        return memory, float(plan[0]) * measurement

class Wordy(PD):
    def step(self, memory, plan, measurement):
        raise ValueError("a2345 " * 40)

ready = PD(gain=7.0)

def wrong(model):
    return "PD"

number = 3
"""
PLANTS = """
import jax.numpy as jnp
import numpy as np
from jcontour import LinearPlant
from jcontour.plant import Plant
from tests import small_loops

class Sliding(small_loops.Sliding):
    def measure(self, state):
        return state[0]

class ThreeOutputs(Sliding):
    def output(self, state):
        return jnp.ones(3)

class Failing(Sliding):
    def output(self, state):
        raise RuntimeError("no tool")

def linear():
    A, B = np.zeros((4, 4)), np.zeros((4, 2))
    A[:2, :2] = A[2:, 2:] = [[1.0, 8e-4], [0.0, 0.6]]
    B[:2, 0] = B[2:, 1] = [2e-4, 0.4]
    C = np.zeros((2, 4))
    C[0, 0] = C[1, 2] = 1.0
    return LinearPlant(A, B, C, 1e-3)

def single():
    return LinearPlant([[1.0, 1e-3], [0.0, 0.9]], [[0.0], [1e-3]], [[1.0, 0.0]], 1e-3)

def coupled():
    plant = linear()
    return LinearPlant(plant.A, plant.B + 0.1 * plant.B[:, ::-1], plant.C, plant.dt)

def unreached():
    plant = linear()
    return LinearPlant(plant.A, 0 * plant.B, plant.C, plant.dt)
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    (folder / "mine.py").write_text(CONTROLLERS)
    (folder / "plants.py").write_text(PLANTS)
    (folder / "empty.py").write_text("x = 3\n")
    (folder / "syntax.py").write_text("x = 1\ny = (\n")
    (folder / "raising.py").write_text("PD = 1\n\nraise KeyError('no key')\n")
    for path in folder.iterdir():  # as a command does that names it
        trust(path.read_bytes())
    return folder


def design(files, name, machine="bridgeport", **flags):
    flags = Simulate(controller=f"{files / 'mine.py'}:{name}", **flags)
    return design_for(machine_named(machine), flags)


def gain_of(found):
    controller: Any = found.build(found.start)
    return float(controller.gain)


def test_names_in_a_file():
    assert own_name("a/mine.py:PD.for_model") == (Path("a/mine.py"), "PD.for_model")
    for words in ("mine.py", "mine:PD", "mine.py:", "mine.py:P D", "contouring-lq"):
        assert own_name(words) is None


@pytest.mark.parametrize(
    ("name", "gain"),
    [
        ("PD", 100.0),
        ("ready", 7.0),
        ("PD.by_model", 2000.0),
        ("Looking", 2000.0),
    ],  # the model's sample is 0.5 ms
)
def test_a_class_an_instance_or_a_function_makes_the_controller(files, name, gain):
    found = design(files, name)
    assert gain_of(found) == gain
    assert found.name == f"mine.py:{name}"


def test_finite_float_fields_are_the_weights(files):
    found = design(files, "PD", weights=("gain=3",))
    assert found.free() == ["gain"] and gain_of(found) == 3
    with pytest.raises(ValueError, match="no weight 'samples'; known are gain"):
        design(files, "PD", weights=("samples=3",))


@pytest.mark.parametrize(("words", "gains"), [("gain=3,4", [3, 4]), ("gain=5", [5, 5])])
def test_a_weight_per_axis_is_given_once_or_for_each(files, words, gains):
    found = design(files, "PerAxis", weights=(words,))
    controller: Any = found.build(found.start)
    assert controller.gain.tolist() == gains


@pytest.mark.parametrize(
    ("name", "words", "says"),
    [
        ("PerAxis", "gain=1,2,3", "weights: gain needs one number or 2, received 'gain=1,2,3'"),
        ("PD", "gain=1,2", "weights: gain needs one number, received 'gain=1,2'"),
    ],
)
def test_more_numbers_than_a_weight_has_are_refused(files, name, words, says):
    with pytest.raises(ValueError, match=says):
        design(files, name, weights=(words,))


def test_flags_that_an_own_controller_does_not_read_are_said(files, recwarn):
    plain = Simulate(controller=f"{files / 'mine.py'}:PD")
    design_for(machine_named("bridgeport"), plain)
    assert not recwarn
    with pytest.warns(UserWarning, match="mine.py:PD does not read --preview"):
        design_for(machine_named("bridgeport"), replace(plain, preview=30))
    with pytest.raises(ValueError, match="no weight 'alpha'; known are gain"):
        design_for(machine_named("bridgeport"), replace(plain, alpha=3.0))


def test_a_class_is_made_for_the_model_and_preview_and_says_what_it_tunes(files):
    found = design(files, "Looking", preview=4)
    assert found.preview == found.build(found.start).preview == 4
    assert found.units() == {"gain": "A/m"} and found.weight_lines(found.start) == [
        "gain  2000 A/m"
    ]
    with pytest.raises(ValueError, match="gain: tuning needs a start between 1 and 5000"):
        design(files, "Looking", weights=("gain=6000",)).check_start()
    with pytest.raises(ValueError, match="no weight 'gains'; known are gain"):
        design(files, "Misnamed")


def test_a_design_of_a_file_goes_the_way_of_those_of_the_catalogue(files):
    found = design(files, "Slow", "flexible-axis")
    assert found.start["position"] == 3.0 and found.line == "A position loop that begins slowly"


def test_without_float_fields_nothing_is_tuned(files):
    with pytest.raises(ValueError, match="mine.py:Open has no free weights"):
        design(files, "Open").check_start()


def line_of(words, program):
    return 1 + program[: program.index(words)].count("\n")


FAULTS = {  # controller -> what is told
    "mine.py:PID": "mine.py: there is no 'PID' in it; perhaps you meant PD; it has PD, ",
    "empty.py:PD": "empty.py: there is no 'PD' in it; it defines no class or function\n",
    "mine.py:number": "or a class or function that makes one, received int",
    "mine.py:eqx.Module": "received another class",
    "mine.py:wrong": "needs to make a Controller, made a str",
    "mine.py:Needy": "cannot be made (TypeError",
    "mine.py:Broken": f"mine.py:{line_of('1 / 0', CONTROLLERS)}: Broken: fails on bridge",
    "mine.py:OneNumber": "OneNumber: step: the control needs shape (2,), received (1,)",
    "mine.py:Deciding": f"py:{line_of('if plan[0]', CONTROLLERS)}: Deciding: fails on bridgeport: "
    "if, while,",
    "mine.py:NumPy": f"py:{line_of('np.asarray', CONTROLLERS)}: NumPy: fails on bridgeport: NumPy",
    "mine.py:Indexing": f"py:{line_of('argmax', CONTROLLERS)}: Indexing: fails on bridgeport: a li",
    "mine.py:Converting": f"py:{line_of('float(plan', CONTROLLERS)}: Converting: fails on brid"
    "geport: float, int",
    "mine.py:Wordy": "a2345 a2345 ...)",
    "none.py:PD": "none.py: cannot be read",
    "syntax.py:PD": "syntax.py:2: PD: the file cannot be run (SyntaxError",
    "raising.py:PD": "raising.py:3: PD: the file cannot be run (KeyError: 'no key')",
    "mine.py": "there is none named 'mine.py'",
    "mine:PD": "there is none named 'mine:PD'",
    "contouring-lq:": "there is none named 'contouring-lq:'",
}
PLANT_FAULTS = {
    "plants.py:number": "there is no 'number' in it",
    "plants.py:Failing": f"plants.py:{line_of('no tool', PLANTS)}: Failing: no machine can",
    "plants.py:ThreeOutputs": "ThreeOutputs: output needs shape (2,), received (3,); a plant has",
    "plants.py:single": "needs two or three outputs",
    "plants.py:coupled": "from jcontour.linear.plant import SteadyMotion\n",
    "plants.py:unreached": "out of reach of the inputs",
    "plants.py:jnp.zeros": "cannot be made",
    "plants.py:Plant": "cannot be made",
    "plants.py:Sliding": "Sliding needs one of your own, --controller FILE.py:NAME",
    "plants.py": "a class of yours as FILE.py:NAME",
    "mine.py:PD": "needs a Plant",
    "bridgeport:": "there is none named 'bridgeport:'",
}
CASES = [("--controller", *case) for case in FAULTS.items()]
CASES += [("--plant", *case) for case in PLANT_FAULTS.items()]


@pytest.mark.slow
@pytest.mark.parametrize(("flag", "name", "says"), CASES)
def test_faults_are_told_in_one_line(capsys, monkeypatch, files, flag, name, says):
    monkeypatch.chdir(files)
    assert main(["simulate", "circle", flag, name]) == 2
    captured = capsys.readouterr()
    told = captured.err.replace("loaded\n", "")
    assert told.count("\n") == 1 and told.startswith("jcontour: ") and says in told
    assert captured.out == "" and not (files / "runs").exists()


@pytest.mark.slow
def test_linear_designs_run_on_a_linear_plant_of_a_file(files):
    machine = machine_named(f"{files / 'plants.py'}:linear")
    assert machine.name == "linear" and machine.model.states == 4
    assert design_for(machine, Simulate()).name == "contouring-lq"


def test_a_file_states_what_is_not_known_of_its_plants(files, tmp_path):
    stated = tmp_path / "stated.py"
    stated.write_text(f'UNCERTAINTY = {{"gain": 0.05, "delay": 2}}\n{PLANTS}')
    for name in ("linear", "Sliding"):
        trust(stated.read_bytes())
        usual, machine = (machine_named(f"{path}:{name}") for path in (files / "plants.py", stated))
        assert usual.family_names[1:] == ["gains 1.1, 0.9", "gains 0.9, 1.1", "1 sample late"]
        assert machine.family_names[1:3] == ["gains 1.05, 0.95", "gains 0.95, 1.05"]
        assert machine.unknown_delay == 2 and machine.remarks == [] and len(usual.remarks) == 1
    stated.write_text(f'UNCERTAINTY = {{"gain": 2}}\n{PLANTS}')
    trust(stated.read_bytes())
    with pytest.raises(ValueError, match="Sliding: uncertainty.gain: needs to be less than 1"):
        machine_named(f"{stated}:Sliding")


def test_a_file_states_limits_and_the_unit_of_the_control_as_a_machine_file(files, tmp_path):
    stated = tmp_path / "stated.py"
    words = 'LIMITS = {"control": [3.0, 4.0], "speed": 0.2}\nCONTROL_UNIT = "A"\n'
    for name in ("linear", "Sliding"):
        stated.write_text(words + PLANTS)
        trust(stated.read_bytes())
        machine = machine_named(f"{stated}:{name}")
        assert machine.control_unit == "A"
        limits = [None if one is None else one.tolist() for one in machine.limits]
        assert limits == [[0.2, 0.2], None, [3.0, 4.0], None, None]
        stated.write_text(words.replace("3.0, 4.0", "3.0") + PLANTS)
        trust(stated.read_bytes())
        with pytest.raises(ValueError, match=f"{name}: limits.control: needs one number or 2"):
            machine_named(f"{stated}:{name}")


@pytest.mark.slow
def test_simulate_with_controller_and_plant_of_files(capsys, files, tmp_path):
    flags = ["--controller", f"{files}/mine.py:PD", "--plant", f"{files}/plants.py:Sliding"]
    run = tmp_path / "run"
    assert main(["simulate", "circle", *flags, "--json", "--out", str(run)]) == 3  # unstable
    found = json.loads(capsys.readouterr().out)  # what the file prints is not there
    assert found["controller"] == "mine.py:PD" and len(found["plants"]) == 4
    assert {path.name for path in run.glob("inputs/*/*")} == {"mine.py", "plants.py"}


def test_a_resumed_run_reads_its_own_copies(files, tmp_path):
    mine, plants, run = files / "mine.py", files / "plants.py", tmp_path / "run"
    flags = Tune(plant=f"{plants}:Sliding", controller=f"{mine}:PD.by_model", out=run)
    created(flags, "tune")
    _, again = resumed(Tune(resume=run), "tune")
    assert again.plant == f"{run}/inputs/0/plants.py:Sliding"
    assert again.controller == f"{run}/inputs/1/mine.py:PD.by_model"
    assert (run / "inputs/1/mine.py").read_bytes() == mine.read_bytes()


@pytest.fixture
def sent(files, tmp_path, monkeypatch):
    """A run folder that somebody else has made: its settings name its own copy of a file."""
    source = tmp_path / "mine.py"
    source.write_text(f"open({str(tmp_path / 'has-run')!r}, 'w')\n{CONTROLLERS}")
    run = tmp_path / "run"
    created(Simulate(contour="circle", controller=f"{source}:PD", out=run), "simulate")
    run_folder.write_json(run / run_folder.RESULT, {"weights": {}})
    source.unlink()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))  # of who receives it
    monkeypatch.setattr(own_classes, "_chosen", set())
    return run


COMMANDS = ("export", "check --bound", "front --against feed", "precompensate")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_run_folder_of_somebody_else_runs_no_code_unasked(capsys, sent, command):
    assert main([*command.split(), str(sent), "--out", str(sent.parent / "out")]) == 2
    told = capsys.readouterr().err
    assert "inputs/0/mine.py: this Python file" in told and told.endswith("--trust-code\n")
    assert not (sent.parent / "has-run").exists()


def test_nor_does_a_file_anywhere_that_its_settings_name(sent):
    copy = sent / "inputs/0/mine.py"
    elsewhere = copy.rename(sent.parent / "other.py")
    trust_named(Export(run=sent, trust_code=True))
    with pytest.raises(UntrustedCodeError, match="other.py"):
        design_for(machine_named("bridgeport"), Simulate(controller=f"{elsewhere}:PD"))
    assert not (sent.parent / "has-run").exists()


def test_code_that_was_chosen_once_runs_again_but_no_other(sent, monkeypatch):
    trust_named(Export(run=sent, trust_code=True))
    monkeypatch.setattr(own_classes, "_chosen", set())  # another command, later
    copy = sent / "inputs/0/mine.py"
    flags = Simulate(controller=f"{copy}:ready")
    assert gain_of(design_for(machine_named("bridgeport"), flags)) == 7.0
    copy.write_text(copy.read_text() + "\n")
    with pytest.raises(UntrustedCodeError):
        design_for(machine_named("bridgeport"), flags)


@pytest.mark.slow
def test_the_controller_of_the_readme_runs_as_it_says(capsys, monkeypatch, tmp_path):
    example = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[0]
    (tmp_path / "mine.py").write_text(example)
    monkeypatch.chdir(tmp_path)
    command = "simulate circle --controller mine.py:Proportional"
    assert f"`jcontour {command}`" in (ROOT / "README.md").read_text()
    assert main([*command.split(), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert not any(metrics["diverged"] for metrics in found["plants"].values())


def test_what_lies_beside_the_file_is_imported_first(tmp_path, monkeypatch):
    """His `tuning.py` and his helper; the program keeps its own modules of these names.

    The second is loaded from below his folder, as out of an environment that lies there.
    """
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv" / "his_helper.py").write_text("TWICE = 0.0\n")
    monkeypatch.syspath_prepend(tmp_path / ".venv")
    installed = importlib.import_module("his_helper")
    (tmp_path / "tuning.py").write_text("GAIN = 7.0\n")
    (tmp_path / "his_helper.py").write_text("import tuning\nTWICE = 2 * tuning.GAIN\n")
    path = tmp_path / "mine.py"
    path.write_text("from his_helper import TWICE\nimport tuning\nBOTH = tuning, TWICE\n")
    trust(path.read_bytes())
    own, twice = own_classes._named(own_classes.OwnName(path, "BOTH"))
    assert (own.GAIN, twice) == (7.0, 14.0)
    assert importlib.import_module("tuning").Problem.__name__ == "Problem"
    assert sys.modules.pop("his_helper") is installed
