"""One whole `jcontour simulate` on a tiny machine."""

import numpy as np
import pytest
import xarray as xr

from jcontour.app.catalogue.choices import seeing_all
from jcontour.app.commands.loops.simulate import _verdict, next_steps
from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.results.stored import read_result
from jcontour.app.flags.loops import Simulate
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.plain_numbers import WholePath
from jcontour.geometry.toolpaths import Toolpath
from tests.app import small_runs
from tests.canonical import DT


@pytest.fixture
def run(tour):
    return tour("simulate").folder


def test_the_result_and_its_signals_agree(run):
    result = read_result(run, SimulatedResult)
    signals = xr.load_dataset(run / "rollouts.nc").isel(design=0, contour=0)
    assert list(signals.plant.values) == list(result.plants)
    counted = signals.scored.values.astype(bool)
    for k, metrics in enumerate(result.plants.values()):
        error = signals.contour_error.values[k, counted]
        assert np.linalg.norm(error, axis=-1).max() == pytest.approx(metrics.peak_contour_error)
    worst = max(metrics.peak_contour_error for metrics in result.plants.values())
    assert result.peak.error == pytest.approx(worst)
    names = {"contour-part.png", "errors-part.png", "result.json", "settings.json", "rollouts.nc"}
    assert names <= {path.name for path in run.iterdir()}


def test_what_comes_next_has_the_part_the_machine_and_the_pace():
    flags = Simulate(contour="my part.ngc", plant="mill.json", feed_law="trapezoidal", json=True)
    [(_, line)] = next_steps(flags)
    assert line == "jcontour tune 'my part.ngc' --plant mill.json --feed-law trapezoidal"
    assert next_steps(Simulate(contour="circle")) == [("Next", "jcontour tune circle")]
    assert next_steps(Simulate()) == [("Next", "jcontour tune")]
    [(_, line)] = next_steps(Simulate(), lost=True)
    assert "jcontour tune" not in line and "nominal plant does not diverge" in line
    heavy = Simulate(contour="circle", alpha=1e30, weights=("beta=1e30",))
    assert next_steps(heavy, saturated=0.9) == [("Next", "jcontour tune circle")]
    assert "--alpha" in next_steps(heavy, saturated=0.02)[0].text
    assert next_steps(Simulate(), lost=False, undefined=True) == [("Next", "jcontour tune")]


@pytest.mark.parametrize("preview", [5, WholePath()])
def test_the_whole_path_is_as_many_samples_as_the_run_has(preview):
    job = small_runs.job("line", np.ones(9, bool))
    assert seeing_all(Simulate(preview=preview), job).preview == (5 if preview == 5 else 9)


def test_every_fault_of_a_run_is_in_its_verdict():
    """Of a motion at 100 mm/s that begins at once, on plants whose tool does not move."""
    counted = np.arange(20) >= 5  # a rapid move comes before
    position = np.zeros((1, 20, 2))
    position[0, :, 0] = 0.1 * DT * np.arange(20)
    program = small_runs.partly(Toolpath, line=np.ones(1, int), rapid=np.zeros(1, bool))
    job = small_runs.job("part", counted, program=program)
    machine = small_runs.machine(
        MachineLimits(acceleration=np.full(2, 5.0), control=np.full(2, 10.0))
    )
    replay = small_runs.replay(20, (1, 3), diverged=np.array([[False, True, False]]))
    replay.control[0, 2, 2, 0], replay.control[0, 0, 15:, 1] = 10.0, np.nan
    plants = ("nominal", "late", "light")
    scenarios = small_runs.scenarios([job], position, counted[None], plants=plants)
    found = _verdict(scenarios, replay, machine)
    assert found.exit_code == 3
    said = [*found.reasons, *found.warnings]
    for words in (
        "it diverges on 1 of 3 plants: late",
        "moves 0 of 1.9 mm (part, nominal)",
        "the control is NaN (not a number) from sample 15 (part, nominal)",
        "acceleration that the motion itself asks for EXCEEDS the limit: X 100 of 5",
        "control of input 1 SATURATES at 5 % of the samples: 10 of 10 A (part, light)",
    ):
        assert any(words in line for line in said), (words, said)
