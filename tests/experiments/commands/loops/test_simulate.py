"""One whole `jcontour simulate` on a tiny machine."""

import json

import numpy as np
import pytest

from experiments.cli import main
from experiments.commands.loops.simulate import next_steps
from experiments.files.netcdf import load_dataset
from experiments.files.results.feed_result import FeedResult
from experiments.files.results.simulated_result import SimulatedResult
from experiments.files.results.stored import read_result
from experiments.flags.loops import Simulate


def simulated(folder, machine_file, part_file, *flags, code=0):
    named = ["simulate", str(part_file), "--plant", str(machine_file), "--preview", "4"]
    assert main([*named, *flags, "--out", str(folder)]) == code
    return folder


@pytest.fixture
def run(tour):
    return tour("simulate").folder


def test_the_result_and_its_signals_agree(run):
    result = read_result(run, SimulatedResult)
    signals = load_dataset(run / "rollouts.nc").isel(design=0, contour=0)
    assert list(signals.plant.values) == list(result.plants)
    counted = signals.scored.values.astype(bool)
    for k, metrics in enumerate(result.plants.values()):
        error = signals.contour_error.values[k, counted]
        assert np.linalg.norm(error, axis=-1).max() == pytest.approx(metrics.peak_contour_error)
    worst = max(metrics.peak_contour_error for metrics in result.plants.values())
    assert result.peak.error == pytest.approx(worst)
    names = {"contour-part.png", "errors-part.png", "result.json", "settings.json", "rollouts.nc"}
    assert names <= {path.name for path in run.iterdir()}


@pytest.mark.slow
def test_rollouts_thinned_or_left_out(tmp_path, run, machine_file, part_file, capsys):
    whole = load_dataset(run / "rollouts.nc")
    thin = simulated(tmp_path / "a", machine_file, part_file, "--rollouts", "thinned")
    kept = load_dataset(thin / "rollouts.nc")
    np.testing.assert_array_equal(kept.output.values, whole.output.values[..., ::2, :])
    np.testing.assert_array_equal(kept.time.values, whole.time.values[::2])
    assert "one sample of 2" in capsys.readouterr().out
    none = simulated(tmp_path / "b", machine_file, part_file, "--rollouts", "none")
    assert not (none / "rollouts.nc").exists()
    said = capsys.readouterr().out
    assert "Rollouts: not kept" in said and "Next: jcontour tune" in said
    assert "Read part: 4 moves" in said and "Largest contour error" in said
    stored = json.loads((none / "result.json").read_text())
    assert stored == json.loads((run / "result.json").read_text())


def test_what_comes_next_has_the_part_the_machine_and_the_pace():
    flags = Simulate(contour="my part.ngc", plant="mill.json", feed_law="trapezoidal", json=True)
    [line] = next_steps(flags)
    assert line == "Next: jcontour tune 'my part.ngc' --plant mill.json --feed-law trapezoidal"
    assert next_steps(Simulate(contour="circle")) == ["Next: jcontour tune circle"]
    assert next_steps(Simulate()) == ["Next: jcontour tune"]
    [line] = next_steps(Simulate(), lost=True)
    assert "jcontour tune" not in line and "nominal plant does not diverge" in line
    assert next_steps(Simulate(), lost=False, undefined=True) == ["Next: jcontour tune"]


NAN = """
import equinox as eqx
import jax.numpy as jnp
from jcontour.controller import Controller

class Rooted(Controller):
    preview: int = eqx.field(static=True, default=0)

    def prepare(self, reference):
        return reference.position[: reference.steps]

    def initial_memory(self, reference):
        return None

    def step(self, memory, plan, measurement):
        return memory, jnp.sqrt(-1 - (plan - measurement[:2]) ** 2)
"""


@pytest.mark.slow
def test_a_control_that_is_no_number_is_told(tmp_path, machine_file, part_file, capsys):
    (tmp_path / "own.py").write_text(NAN)
    own, run = f"{tmp_path}/own.py:Rooted", tmp_path / "run"
    named = [str(part_file), "--plant", str(machine_file), "--controller", own]
    assert main(["simulate", *named, "--out", str(run)]) == 3  # it diverges
    said = " ".join(capsys.readouterr().out.split())
    assert "control is NaN (not a number) from sample 0 (part, nominal): look for" in said
    assert "Next: mend what is NaN (not a number), see the warning" in said
    assert len(read_result(run, SimulatedResult).verdict.warnings) == 1


@pytest.mark.slow
def test_two_half_circles_on_unequal_axes(tmp_path, machine_fields):
    machine, part = tmp_path / "unequal.json", tmp_path / "circle.ngc"
    limits = machine_fields["limits"] | {"acceleration": [4000.0, 12000.0]}
    machine.write_text(json.dumps(machine_fields | {"limits": limits}))
    part.write_text("G21 G90 F3000\nG2 X2 Y0 I1 J0\nG2 X0 Y0 I-1 J0\n")
    result = read_result(simulated(tmp_path / "run", machine, part), SimulatedResult)
    assert result.motion is not None and result.motion.stops == 0


@pytest.mark.slow
def test_a_drive_at_its_limit_in_a_rapid_move_is_told(tmp_path, machine_fields, capsys):
    machine, part = tmp_path / "weak.json", tmp_path / "slot.ngc"
    limits = machine_fields["limits"] | {"speed": 200.0, "control": 100.0}
    machine.write_text(json.dumps(machine_fields | {"limits": limits}))
    part.write_text("G21 G90 F600\nG1 Y2\nG0 X40\nG1 Y0\n")
    run = simulated(tmp_path / "run", machine, part, code=3)  # the rapid move is too quick
    told = read_result(run, SimulatedResult).verdict.warnings
    assert any("control of input 1 is at its limit in a rapid move" in line for line in told)
    assert f"WARNING: {told[0]}" in " ".join(capsys.readouterr().out.split())
    part.write_text("G21 G90 F600\nG1 X4\nG1 Y5\n")
    assert (
        read_result(simulated(tmp_path / "cut", machine, part), SimulatedResult).verdict.warnings
        == []
    )


@pytest.mark.slow
def test_a_motion_that_exceeds_a_limit_itself_is_told_before_its_tool(
    tmp_path, machine_fields, part_file, capsys
):
    machine = tmp_path / "weak.json"
    limits = machine_fields["limits"] | {"acceleration": 200.0}
    machine.write_text(json.dumps(machine_fields | {"limits": limits}))
    jumping = simulated(tmp_path / "a", machine, part_file, "--feed-law", "trapezoidal", code=3)
    told = read_result(jumping, SimulatedResult).verdict.warnings
    assert told[0].startswith("acceleration that the motion itself asks for EXCEEDS the limit: ")
    assert f"WARNING: {told[0]}" in " ".join(capsys.readouterr().out.split())
    limited = read_result(simulated(tmp_path / "b", machine, part_file), SimulatedResult)
    assert not any("the motion itself" in line for line in limited.verdict.warnings)
    flags = ["--plant", str(machine), "--overrides", "50", "--feed-law", "trapezoidal"]
    main(["feed", str(part_file), *flags, "--out", str(tmp_path / "feed")])
    [point] = read_result(tmp_path / "feed", FeedResult).points
    assert "the motion itself" in point.planned[0]


@pytest.mark.slow
def test_the_whole_path_is_kept_as_its_samples(tmp_path, capsys):
    out = str(tmp_path / "run")
    assert main(["simulate", "circle", "--preview", "path", "--json", "--out", out]) == 0
    found = json.loads(capsys.readouterr().out)
    kept = json.loads((tmp_path / "run" / "settings.json").read_text())
    assert found["preview"] == found["samples"] == kept["flags"]["preview"]
