"""Weights of a loop and their space."""

import numpy as np

from jcontour.app.designs.lq.loop_weights import LoopSpace, LoopWeights
from jcontour.arrays import placed
from tuning.parameters import Chart, Positive


def test_what_a_loop_does_not_have_is_not_moved():
    """Fed the state, alpha and beta alone are free."""
    chart = Chart(LoopSpace(), LoopWeights(2.0, 3.0, 1e-6))
    np.testing.assert_allclose(chart.coordinates(), np.log([2.0, 3.0]))
    moved = chart.weights(placed(np.zeros(2)))
    assert (moved.alpha, moved.beta, moved.rho) == (1.0, 1.0, 1e-6)
    assert moved.stage is None and moved.drift is None


def test_the_observer_has_two_weights_more():
    space = LoopSpace(control_noise=Positive(), drift=Positive())
    chart = Chart(space, LoopWeights(2.0, 3.0, 1e-6, None, 0.1, 1e-3))
    np.testing.assert_allclose(chart.coordinates(), np.log([2.0, 3.0, 0.1, 1e-3]))


def test_the_cost_is_that_of_the_controller():
    cost = LoopWeights(2.0, 3.0, 1e-6, np.ones(4), 0.1, 1e-3).cost
    assert (float(cost.alpha), float(cost.beta), float(cost.rho)) == (2.0, 3.0, 1e-6)
    assert cost.stage.shape == (4,)
