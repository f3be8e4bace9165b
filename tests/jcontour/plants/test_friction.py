import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants import friction as module
from jcontour.plants.friction import Friction, runge_kutta

slipping, smooth, released, caught = map(
    jax.jit, (Friction.slipping, Friction.smooth, Friction.released, module.caught)
)


@pytest.fixture(scope="module")
def friction():
    return Friction(coulomb=36.36, stribeck=22.04, stribeck_speed=2.82, viscous=250.9)


@pytest.mark.parametrize(
    ("speed", "force"), [(0.0, 58.4), (2.82, 36.36 + 11.02 + 250.9 * 2.82), (1e9, 36.36 + 250.9e9)]
)
def test_force_at_rest_at_the_stribeck_speed_and_far_beyond(friction, speed, force):
    np.testing.assert_allclose(
        slipping(friction, np.array([1]), np.array([speed])), force, rtol=1e-12
    )
    np.testing.assert_allclose(
        slipping(friction, np.array([-1]), -np.array([speed])), -force, rtol=1e-12
    )


def test_smooth_twin_becomes_the_slipping_force(friction):
    speeds = np.array([-0.3, 0.01, 2.0])
    np.testing.assert_allclose(
        smooth(friction, speeds, 1e5),
        slipping(friction, np.array([-1, 1, 1]), speeds),
        rtol=1e-12,
    )
    assert smooth(friction, np.zeros(1), 1e5) == 0


def test_modes(friction):
    force = np.array([58.39, 58.41, -58.41, 1e3])
    np.testing.assert_array_equal(
        released(friction, np.array([0, 0, 0, -1]), force), [0, 1, -1, -1]
    )
    np.testing.assert_array_equal(
        caught(np.array([1, 1, -1, -1, 0]), np.array([1e-9, -1e-9, -1e-9, 1e-9, 0.0])),
        [1, 0, -1, 0, 0],
    )


@pytest.mark.parametrize("name", ["coulomb", "stribeck", "stribeck_speed", "viscous"])
def test_bad_values_are_named(name):
    good = {"coulomb": 1.0, "stribeck": 1.0, "stribeck_speed": 1.0, "viscous": 1.0}
    for bad in (-1.0, np.nan):
        with pytest.raises(ValueError, match=f"^{name}:"):
            Friction(**{**good, name: bad})
    with pytest.raises(ValueError, match="stribeck_speed: needs to be finite and above zero"):
        Friction(1.0, 1.0, 0.0, 1.0)


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
