from dataclasses import replace

import equinox as eqx
import jax
import numpy as np

from jcontour._arrays import placed
from jcontour.controllers.lq.contouring_lq import ModelFeedback
from jcontour.geometry.contours import circle
from jcontour.linear.plant import AffinePlan, LinearPlant
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import simulate


class Given(ModelFeedback):
    plan: AffinePlan
    model: LinearPlant
    preview: int = eqx.field(static=True, default=0)

    def gain_schedule(self, reference):
        return self.plan


def test_the_control_is_that_of_the_plan(two_axes):
    random = np.random.default_rng(0)
    plan = AffinePlan(*(placed(random.standard_normal(s)) for s in ((5, 2, 4), (5, 2))))
    reference = along(circle(1e-2), 1e-4 * np.arange(5), 1e-3, 0, at_rest=True)
    found = jax.device_get(simulate(two_axes, Given(plan, two_axes), reference))
    x = found.state[0]
    for k in range(5):
        u = plan.f[k] - plan.F[k] @ x
        np.testing.assert_allclose(found.control[k], u, rtol=1e-12, atol=1e-15)
        x = np.asarray(two_axes.A) @ x + np.asarray(two_axes.B) @ u


def test_the_control_of_a_drive_that_takes_a_position_counts_from_where_it_stands():
    """It is planned from zero there: u = y_0 / K + f - F (x - x_0), by hand."""
    gain, pole = np.array([2.0, 0.5]), np.array([0.9, 0.8])
    drives = LinearPlant(np.diag(pole), np.diag(gain * (1 - pole)), np.eye(2), 1e-3)
    random = np.random.default_rng(1)
    plan = AffinePlan(*(placed(random.standard_normal(s)) for s in ((5, 2, 2), (5, 2))))
    reference = along(circle(1e-2), 1e-4 * np.arange(5), 1e-3, 0, at_rest=True)
    start = np.asarray(reference.position)[0] + np.array([0.3, -0.7])
    reference = replace(reference, position=reference.position + np.array([[0.3, -0.7]]))
    found = jax.device_get(Given(plan, drives).prepare(reference))
    x = random.standard_normal(2)
    for k in range(5):
        u = start / gain + plan.f[k] - plan.F[k] @ (x - start)
        np.testing.assert_allclose(found.f[k] - found.F[k] @ x, u, rtol=1e-12)
