"""Controllers that learn while they run: what they learn on their machines, and bad input."""

import jax
import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for
from jcontour.app.flags.loops import Simulate
from jcontour.app.machines.gantry import gantry_machine
from jcontour.app.machines.linear import bridgeport_machine
from jcontour.geometry.contours import circle
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import simulate


@pytest.fixture(scope="module")
def machine():
    return bridgeport_machine()


def design(machine, name, *weights):
    return design_for(machine, Simulate(controller=name, weights=weights))


@pytest.mark.slow
def test_the_gain_of_every_motor_is_learned():
    """b = k T^2 / (2 M), of a drive half of what moves along y.

    The law takes viscous friction v for more mass. On a circle, at w, it learns b w^2/(w^2 + v^2).
    """
    gantry = gantry_machine()
    found = design(gantry, "self-tuning")
    p, dt, w = gantry.parameters, gantry.model.dt, 0.15 / 20e-3
    path = circle(20e-3)
    arc = 0.15 * dt * np.arange(1200)
    controller = found.build(found.start)
    reference = along(path, arc, dt, controller.preview, at_rest=True)
    run = jax.jit(simulate)(gantry.nominal(), controller, reference)
    constant = np.array([p.head_constant, 2 * p.drive_constant])
    mass = np.array([p.head_mass, p.total_mass])
    drag = np.array([p.head_viscous, 2 * p.drive_viscous]) / mass
    head, drives = constant / mass * dt**2 / 2 * w**2 / (w**2 + drag**2)
    np.testing.assert_allclose(run.final_memory.gain, [head, drives, drives], rtol=0.1)


@pytest.mark.slow
def test_the_period_of_the_flags_counts(machine):
    found = design(machine, "repetitive", "period=0.05")
    assert found.start["period"] == 0.05
    assert found.build(found.start).filter.period == round(0.05 / machine.model.dt)
    turned = design(machine, "run-out", "frequency=100").build(design(machine, "run-out").start)
    assert float(turned.canceller.frequency[0]) == pytest.approx(100 * machine.model.dt)


@pytest.mark.slow
def test_bad_input(machine):
    with pytest.raises(ValueError, match="period: needs a whole number"):
        design(machine, "repetitive", "period=0.0501234")
    with pytest.raises(ValueError, match="frequency: needs to be above zero and below pi"):
        design(machine, "run-out", "frequency=1e5")
