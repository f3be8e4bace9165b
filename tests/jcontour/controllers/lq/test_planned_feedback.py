import equinox as eqx
import jax
import numpy as np

from jcontour.arrays import placed
from jcontour.controllers.lq.planned_feedback import PlannedFeedback
from jcontour.geometry.contours import circle
from jcontour.linear.plant import AffinePlan
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import simulate


class Given(PlannedFeedback):
    plan: AffinePlan
    preview: int = eqx.field(static=True, default=0)

    def prepare(self, reference):
        return self.plan


def test_the_control_is_that_of_the_plan(two_axes):
    random = np.random.default_rng(0)
    plan = AffinePlan(*(placed(random.standard_normal(s)) for s in ((5, 2, 4), (5, 2))))
    reference = along(circle(1e-2), 1e-4 * np.arange(5), 1e-3, 0, at_rest=True)
    found = jax.device_get(simulate(two_axes, Given(plan), reference))
    x = found.state[0]
    for k in range(5):
        u = plan.f[k] - plan.F[k] @ x
        np.testing.assert_allclose(found.control[k], u, rtol=1e-12, atol=1e-15)
        x = np.asarray(two_axes.A) @ x + np.asarray(two_axes.B) @ u
