"""Exported laws in LinuxCNC's servo thread, beside `simulate` on the samples of its planner."""

from pathlib import Path

import numpy as np
import pytest

from jcontour.app.catalogue.choices import job_named
from jcontour.app.commands.loops.check_in_linuxcnc import compared
from jcontour.app.flags.loops import Simulate
from jcontour.app.runs.checks.exported_code import distance_to_path, missing
from jcontour.app.runs.stored_loops import loop_of

HERE = Path(__file__).parent / "parts"
BUILT_IN = Path("jcontour/app/jobs/toolpaths")
PARTS = [HERE / f"{name}.ngc" for name in ("square", "lobes", "pocket")]
PARTS += [BUILT_IN / f"{name}.ngc" for name in ("bracket", "cam")]
NEAR = 0.05  # of the RMS contour error of `simulate`
COUNT = 0.25  # of a count: they are met at other samples, and friction holds a tool between two

needs_linuxcnc = pytest.mark.skipif(bool(missing()), reason=missing())


@pytest.fixture(scope="module", params=["mill", "slide"])
def loop(request):
    """A machine whose drives take a speed, and one that takes a force, both with friction."""
    plant = str(HERE / f"{request.param}.json")
    return loop_of(Simulate(plant=plant), str(PARTS[0]))


@needs_linuxcnc
@pytest.mark.parametrize(
    "part", [PARTS[0], *(pytest.param(one, marks=pytest.mark.slow) for one in PARTS[1:])]
)
def test_the_contour_error_is_that_of_simulate(loop, part):
    row, _ = compared(loop, job_named(str(part), loop.pace), part.read_text())
    print(loop.machine.name, row)
    count = float(np.max(loop.machine.resolution))
    assert abs(row.real_rms - row.simulated_rms) < NEAR * row.simulated_rms + COUNT * count
    assert row.samples * loop.machine.model.dt > row.real_time > 0.1


@needs_linuxcnc
def test_a_program_that_linuxcnc_does_not_read_is_refused_in_its_words(loop):
    job = job_named(str(PARTS[0]), loop.pace)
    with pytest.raises(ValueError, match="File ended with no percent sign or program end"):
        compared(loop, job, "G21 G90\nG1 X2 F600\n")


def test_the_distance_to_a_path_is_that_to_its_nearest_piece():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    places = np.array([[0.5, 0.25], [1.5, 0.5], [-3.0, 4.0], [1.0, 0.0]])
    assert distance_to_path(path, places).tolist() == [0.25, 0.5, 5.0, 0.0]
