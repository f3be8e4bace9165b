import jax
import jax.numpy as jnp
import numpy as np

from jcontour import contours, feed_laws, references
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.wrappers.adapters import SpeedByDifference
from jcontour.export.safe_limits import memory_limits
from jcontour.sensors import Sensors, motors
from tests.small_loops import OnPositions

DT = 1e-3


def limits_of(controller, measured):
    path = contours.circle(1e-3)
    arc = feed_laws.constant_feed(path, 0.05, DT)[:10]
    reference = references.along(path, arc, DT, preview=1, at_rest=False)
    plan = jax.tree.map(lambda leaf: leaf[3], controller.prepare(reference))
    return memory_limits(
        controller, plan, controller.initial_memory(reference), jnp.zeros(measured)
    )


def cascade(limit):
    gains = CascadeGains(30.0, 20.0, 0.02, 1.0)
    return SpeedByDifference(Cascade(gains, motors(2), DT, np.array(limit)), Sensors([0, 1]), DT)


def test_the_integrators_of_a_cascade_are_kept_and_its_last_positions_are_not():
    kept, exact = limits_of(cascade([3.0, 7.0]), 2)
    assert exact and kept is not None and kept.tolist() == [np.inf, np.inf, 3.0, 7.0]
    assert limits_of(cascade([np.inf, np.inf]), 2) == (None, True)
    one, exact = limits_of(cascade([np.inf, 7.0]), 2)
    assert exact and one is not None and one.tolist() == [np.inf, np.inf, np.inf, 7.0]


class Stopped(OnPositions):
    """An integrator that stands still while the control is at its limit."""

    limit: jax.Array

    def initial_memory(self, reference):
        return jnp.zeros(2)

    def step(self, memory, plan, measurement):
        wanted = memory + 5.0 * (plan - measurement)
        control = jnp.clip(wanted, -self.limit, self.limit)
        return jnp.where(control == wanted, memory + 0.1 * (plan - measurement), memory), control


def test_limits_that_do_something_else_to_the_memory_are_told():
    assert limits_of(Stopped(jnp.asarray(2.0)), 2) == (None, False)
    assert limits_of(Stopped(jnp.asarray(np.inf)), 2) == (None, True)
