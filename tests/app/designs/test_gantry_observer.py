"""Contouring LQ of gantries behind its observer."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.sensitivity import probe_windows
from jcontour.app.catalogue.choices import design_for, job_named
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.job import Pace
from jcontour.app.machines.gantry import gantry_machine
from jcontour.app.runs.tuning.limits import probed_peaks
from jcontour.geometry.contours import line
from jcontour.motion.references import along
from jcontour.plants.actuation import Disturbed
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import stack_plants, stack_references

PREVIEW = 7


@pytest.fixture(scope="module")
def machine():
    return gantry_machine()


def built(machine, name="gantry-offset-free-lq", delay=None):
    design = design_for(machine, Simulate(controller=name, preview=PREVIEW, model_delay=delay))
    return design, design.build(design.start)


@pytest.mark.slow
@pytest.mark.parametrize(("asked", "late"), [(None, 1), (1, 1), (0, 0)])
def test_the_model_predicts_over_the_whole_delay_unless_told(machine, asked, late):
    design, controller = built(machine, delay=asked)
    assert controller.model.states == 6 + 3 * late
    assert design.settings() == {"preview": PREVIEW, "model_delay": late}


@pytest.mark.parametrize("asked", [-1, 2])
def test_a_delay_that_the_machine_has_not_is_refused(machine, asked):
    with pytest.raises(ValueError, match=rf"model-delay: gantry may be 0 to 1.*received {asked}"):
        built(machine, delay=asked)


@pytest.mark.slow
def test_speeds_by_difference_are_not_read(machine):
    _, controller = built(machine)
    assert controller.gain.shape == (6 + 3 + 3, 6)
    np.testing.assert_array_equal(controller.gain[:, 3:], 0.0)
    assert np.abs(controller.gain[:, :3]).max() > 0.1


def error_at_rest(machine, name):
    """Largest error [m] after two seconds at rest under 1 A in each motor."""
    _, controller = built(machine, name, delay=None if name == "contouring-lq" else 0)
    path = line(np.zeros(2), np.array([0.1, 0.0]))
    rest = along(path, np.zeros(2000), machine.model.dt, PREVIEW, at_rest=True)
    loaded = Disturbed(machine.model, force=jnp.ones((1, 3)))
    run = simulate(loaded, controller, rest)
    return float(np.abs(run.output[-1] - rest.position[0]).max())


@pytest.mark.slow
def test_a_constant_load_leaves_no_error(machine):
    assert error_at_rest(machine, "gantry-offset-free-lq") < 1e-8
    assert error_at_rest(machine, "contouring-lq") > 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cushion-right", "ring-left"])
def test_the_start_keeps_the_usual_margin_on_every_plant(machine, name):
    _, controller = built(machine)
    job = job_named(name, Pace(machine, None, None))
    windows = probe_windows(stack_references([job.reference(machine.model.dt, PREVIEW)]), 4)
    peaks = probed_peaks(stack_plants(machine.smooth_family()), controller, windows)
    assert np.max(peaks.sensitivity) < 2.0
