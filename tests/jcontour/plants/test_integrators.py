import jax
import jax.numpy as jnp
import numpy as np

from jcontour.plants.integrators import runge_kutta


def pendulum(state):
    angle, speed = state
    return speed, -jnp.sin(angle)


def swung(steps, span=2.0):
    """Angle and speed after `span` seconds from 1 rad at rest."""
    return np.array(_swung(steps, span / steps))


@jax.jit
def _swung(steps, step):
    start = (jnp.asarray(1.0), jnp.asarray(0.0))
    return jax.lax.fori_loop(0, steps, lambda _, x: runge_kutta(pendulum, x, step), start)


def test_one_step_is_the_exponential_to_fourth_order():
    h = 0.1
    found = runge_kutta(lambda x: -x, np.asarray(1.0), h)
    np.testing.assert_allclose(found, 1 - h + h**2 / 2 - h**3 / 6 + h**4 / 24, rtol=1e-15)


def test_the_error_falls_with_the_fourth_power_of_the_step():
    exact = swung(1280)
    errors = [np.abs(swung(steps) - exact).max() for steps in (10, 20, 40)]
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 16, rtol=0.2)
