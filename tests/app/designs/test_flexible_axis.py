"""Controllers of flexible axes: loops built from gains, derivatives by name, files."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for
from jcontour.app.designs.flexible_axis import AxisCascade, AxisLQ
from jcontour.app.flags.loops import Simulate
from jcontour.app.jobs.contours import BUILT_IN
from jcontour.app.jobs.job import Pace
from jcontour.app.machines.flexible_axis import biaxial_machine, thesis_machine
from jcontour.app.machines.machine import MachineLimits
from jcontour.geometry.contours import line
from jcontour.motion.references import from_samples
from jcontour.plants.actuation import Saturated
from jcontour.simulation.closed_loop import simulate


@pytest.fixture(scope="module")
def machine():
    return thesis_machine()


@pytest.mark.slow
def test_the_velocity_loop_of_a_lighter_axis_is_as_fast(machine):
    pair = biaxial_machine()
    start = AxisCascade("", pair, Simulate()).start["velocity"]
    p, thesis = pair.parameters, AxisCascade("", machine, Simulate()).start["velocity"]
    speed = start * p.force_constant / (p.motor_mass + p.tool_mass)
    np.testing.assert_allclose(speed, thesis * 79.33 / 40.0, rtol=1e-12)
    assert float(thesis) == pytest.approx(55.67)


@pytest.mark.slow
def test_axes_side_by_side_have_the_gains_of_each_alone(machine):
    pair = biaxial_machine()
    side_by_side, single = (AxisLQ("", one, Simulate()) for one in (pair, machine))
    both, alone = (one.regulator(single.start).gain for one in (side_by_side, single))
    np.testing.assert_allclose(both[0, ::2], alone[0], rtol=1e-9)
    np.testing.assert_array_equal(both[0, 1::2], 0.0)


@pytest.mark.slow
def test_the_drive_limits_the_current(machine):
    unlimited = AxisCascade("", machine, Simulate())
    assert np.isinf(unlimited.cascade(unlimited.start).limit)
    free = biaxial_machine()
    axis = replace(free, limits=free.limits._replace(control=np.array([3.0, 2.0])))
    limited = AxisCascade("", axis, Simulate())
    np.testing.assert_array_equal(limited.cascade(limited.start).limit, [3.0, 2.0])


def test_what_is_kept_of_a_design(machine, tmp_path):
    design = design_for(machine, Simulate(controller="cascade-leso", weights=("position=40",)))
    assert float(design.start["position"]) == 40.0
    design.save(design.build(design.start), None, tmp_path)
    kept = json.loads((tmp_path / "controller.json").read_text())
    assert kept["dt"] == 1e-3 and kept["numbers"]["controller.gains.position"] == 40.0
    assert kept["numbers"]["observer.bandwidth"] == 700.0
    assert "position" in design.description()["Free"] and design.settings() == {"preview": 1}


def test_a_motion_is_long_enough(machine):
    motion = BUILT_IN["task-a"](Pace(machine, None, None))
    assert motion.samples == 2201


@pytest.mark.slow
def test_time_delay_control_keeps_the_limit_of_the_drive(machine):
    """On a step of 50 mm, which asks for more than the drive has. A sum that winds up runs away."""
    limited = replace(machine, limits=MachineLimits(control=np.array([10.0])))
    design, plant = (
        design_for(limited, Simulate(controller="time-delay")),
        limited.smooth_family()[0],
    )
    wanted, contour = np.full((1501, 1), 0.05), line([0.0], [0.1])
    ahead = np.ones_like(wanted)
    reference = from_samples(wanted, ahead, machine.model.dt, 1, contour, in_motion=False)
    rest = plant.initial_state(np.zeros(1), np.zeros(1))
    run = simulate(Saturated(plant, jnp.array([10.0])), design.build(design.start), reference, rest)
    assert np.abs(run.control).max() == 10.0
    assert np.max(run.output) < 0.053
    np.testing.assert_allclose(run.output[-1], 0.05, rtol=0, atol=1e-4)
