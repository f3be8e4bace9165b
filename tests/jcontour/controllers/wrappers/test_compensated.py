from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.wrappers.filters import Compensated
from jcontour.geometry.contours import line
from jcontour.motion.references import along
from jcontour.plant import Plant
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import simulate

DT, STIFFNESS = 1e-3, 4e3


@cache
def short_task():
    return along(line([0.0], [0.02]), 1e-4 * np.arange(200), DT, 1, at_rest=False)


@cache
def stiff_cascade():
    return Cascade(CascadeGains(30.0, 50.0, 0.05), motors(1), DT)


class Mass(Plant):
    """A mass on a spring that hardens, x'' = u - k (x + 100 x^3), by one explicit step."""

    stiffness: float
    dt: float = eqx.field(static=True, default=DT)

    def initial_state(self, position, increment):
        return jnp.stack([position[0], increment[0] / DT])

    def step(self, state, control):
        x, v = state
        v = v + DT * (control[0] - self.stiffness * (x + 100 * x**3))
        return jnp.stack([x + DT * v, v])

    def output(self, state):
        return state[:1]

    def measure(self, state):
        return state[:1], state[1:]


class Cancelling(eqx.Module):
    stiffness: jax.Array

    def __call__(self, measurement, control):
        x, _ = measurement
        return self.stiffness * (x + 100 * x**3)


def test_what_is_cancelled_is_as_if_it_were_not_there():
    free = simulate(Mass(0.0), stiff_cascade(), short_task())
    held = simulate(
        Mass(STIFFNESS),
        Compensated(stiff_cascade(), Cancelling(STIFFNESS)),
        short_task(),
    )
    np.testing.assert_allclose(held.output, free.output, rtol=0, atol=1e-12)
    np.testing.assert_allclose(held.memory, free.memory, rtol=0, atol=1e-10)
    uncompensated = simulate(Mass(STIFFNESS), stiff_cascade(), short_task())
    assert np.abs(np.subtract(uncompensated.output, free.output)).max() > 1e-3


def test_the_compensation_sees_the_control_of_the_one_inside():
    """Adding what it is asked for doubles the loop's gain."""
    doubled = simulate(
        Mass(0.0), Compensated(stiff_cascade(), lambda _, control: control), short_task()
    )
    wanted = simulate(
        Mass(0.0), Cascade(CascadeGains(30.0, 100.0, 0.05), motors(1), DT), short_task()
    )
    np.testing.assert_allclose(doubled.output, wanted.output, rtol=0, atol=1e-12)


def test_a_compensation_of_another_size_is_refused():
    with pytest.raises(
        ValueError, match=r"compensation: needs the control's shape \(1,\), received \(\)"
    ):
        simulate(
            Mass(0.0),
            Compensated(stiff_cascade(), lambda measurement, control: control[0]),
            short_task(),
        )
