"""Controllers that learn while they run: what they learn on their machines, and bad input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for
from jcontour.app.flags.loops import Simulate
from jcontour.app.machines.gantry import gantry_machine
from jcontour.app.machines.linear import bridgeport_machine
from jcontour.geometry.contours import circle, line
from jcontour.motion.references import along, from_samples
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.simulation.closed_loop import simulate


@pytest.fixture(scope="module")
def machine():
    return bridgeport_machine()


def design(machine, name, *weights):
    return design_for(machine, Simulate(controller=name, weights=weights))


def still(machine, steps, preview):
    """At rest, on a line that is longer than any error."""
    samples = np.zeros((steps + preview, 2))
    ahead = np.tile([1.0, 0.0], (len(samples), 1))
    contour = line([0.0, 0.0], [0.1, 0.0])
    return from_samples(samples, ahead, machine.model.dt, preview, contour, in_motion=False)


def shaken(machine, controller, period, steps):
    """RMS position in the first quarter and the last under a force of one period."""
    angle = 2 * np.pi * np.arange(steps)[:, None] / period
    force = 0.05 * np.concatenate([np.sin(angle), np.cos(angle)], axis=1)
    plant = Disturbed(machine.nominal(), force=jnp.asarray(force))
    run = jax.jit(simulate)(plant, controller, still(machine, steps, controller.preview))
    rms = np.sqrt(np.mean(np.asarray(run.output) ** 2, axis=1))
    return rms[: steps // 4].max(), rms[-steps // 4 :].max()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["repetitive", "run-out"])
def test_what_repeats_is_learned(machine, name):
    """A force ten times a second, as long as the period and the frequency that are meant."""
    found = design(machine, name)
    period = round(0.1 / machine.model.dt)
    before, after = shaken(machine, found.build(found.start), period, 60 * period)
    assert after < 0.1 * before
    plain = design(machine, "cascade")
    loops = {key: found.start[key] for key in plain.start}
    assert shaken(machine, plain.build(loops), period, 60 * period)[1] > 0.9 * before


@pytest.mark.slow
def test_the_position_loop_is_learned(machine):
    """Behind the filter of the first model the circle is farther off than behind the learned."""
    found = design(machine, "adaptive-zpetc")
    dt, laps = machine.model.dt, 3
    path = circle(10e-3)
    steps = round(float(path.length) / 0.05 / dt)
    arc = 0.05 * dt * np.arange(laps * steps)
    errors = {}
    for trace in (found.start["trace"], 1e-9):
        controller = found.build({**found.start, "trace": trace})
        reference = along(path, arc, dt, controller.preview, at_rest=False)
        run = jax.jit(simulate)(machine.nominal(), controller, reference)
        error = np.asarray(run.output - reference.position[: reference.steps])[-steps:]
        errors[trace] = np.sqrt(np.mean(error**2))
    assert errors[found.start["trace"]] < 0.7 * errors[1e-9]


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
    with pytest.raises(ValueError, match="period: needs a whole number of samples"):
        design(machine, "repetitive", "period=0.0501234")
    with pytest.raises(ValueError, match="frequency: needs to be above zero and below pi"):
        design(machine, "run-out", "frequency=1e5")
