"""A loop at other gains is that of a plant with them."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.bounds.disturbed_loop import DisturbedLoop, disturbed_loop
from jcontour.bounds.gains.gained_loops import gained
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.lq.preview_lq import PreviewLQ
from jcontour.geometry.contours import circle, line
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.plants.actuation import Gained
from jcontour.plants.delays import Delayed
from jcontour.plants.linear_machines import bridgeport
from jcontour.simulation.closed_loop import simulate


def test_one_integrator_by_hand():
    """x(k+1) = x + u + force, u = -x/2 + 1 and so at gain 2: x(k+1) = 2 + 2 force."""
    M, E, one = np.full((3, 1, 1), 0.5), np.ones((3, 1, 1)), np.ones((3, 1, 1))
    none = np.zeros((3, 1, 0))
    x = np.array([0.0, 1.0, 1.5])[:, None]  # at gain one
    loop = DisturbedLoop(M, E, one, -one / 2, none, x, 1 - x / 2)
    found = gained(loop, np.array([2.0]))
    assert np.ravel(found.M).tolist() == [0.0] * 3 and np.ravel(found.E).tolist() == [2.0] * 3
    assert np.ravel(found.output).tolist() == [0.0, 2.0, 2.0]
    assert np.ravel(found.control).tolist() == [1.0, 0.0, 0.0]


@pytest.mark.slow
def test_a_late_plant_with_other_gains_has_the_same_run_and_answers():
    model, gains = bridgeport(), np.array([1.1, 0.9])
    reference = along(circle(1e-3), 2.5e-5 * np.arange(60), model.dt, 5, at_rest=False)
    controller = ContouringLQ(model, LQWeights(3.0, 5.0, 2e-9), preview=5)
    late = Delayed(model, jnp.asarray(1), 2, 2)
    loops = [
        disturbed_loop(Gained(late, one), controller, reference) for one in (np.ones(2), gains)
    ]
    found = gained(loops[0], gains)
    assert np.asarray(found.output) == pytest.approx(np.asarray(loops[1].output), abs=1e-15)
    assert np.asarray(found.control) == pytest.approx(np.asarray(loops[1].control), abs=1e-10)
    answers = []  # of the tool at the end: the states themselves hold other numbers in their lines
    for loop in (found, loops[1]):
        row = np.asarray(loop.C[-1])
        for k in range(58, 50, -1):
            row = row @ np.asarray(loop.M[k])
        answers.append(row @ np.asarray(loop.E[50]))
    assert np.abs(answers[0]).max() > 0
    assert answers[0] == pytest.approx(answers[1], rel=1e-9, abs=1e-18)


@pytest.mark.slow
def test_a_gain_acts_about_the_control_that_holds_the_start():
    """Drives that take a position, away from zero: the run is that of `Gained`."""
    model = LinearPlant(np.diag([0.9, 0.8]), np.diag([0.1, 0.2]), np.eye(2), 1e-3)
    gains, place = np.array([1.3, 0.8]), np.array([0.03, -0.05])
    reference = along(line(place, place + 0.01), 1e-5 * np.arange(40), 1e-3, 2, at_rest=True)
    controller = PreviewLQ(model, 1e8, 1.0, 2)
    loop = disturbed_loop(model, controller, reference)
    found = gained(loop, gains)
    run = simulate(Gained(model, jnp.asarray(gains)), controller, reference)
    assert np.abs(found.output - loop.output).max() > 1e-6
    np.testing.assert_allclose(found.output, run.output, rtol=1e-12)
    np.testing.assert_allclose(found.control, run.control, rtol=1e-12)
