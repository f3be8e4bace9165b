import jax.numpy as jnp
import numpy as np

from jcontour.plants.wrappers.delays import Delayed, LateSensors
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.plants.wrappers.encoders import CountingEncoders, Encoders
from jcontour.plants.wrappers.saturation import Saturated
from jcontour.sensors import Sensors
from jcontour.wrapper import unwrapped


def test_wrappers_nest(two_axes, start, controls, run):
    limit = jnp.array([5e-3, 5e-3])
    plant = Encoders(Saturated(Delayed(two_axes, jnp.asarray(1), 2, 2), limit))
    state = plant.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))
    outputs, measurements, _ = run(plant, state, controls)
    late = np.concatenate([np.zeros((1, 2)), np.clip(controls, -limit, limit)])[:8]
    np.testing.assert_allclose(measurements, run(two_axes, start, late)[0], rtol=1e-14)
    np.testing.assert_array_equal(outputs, measurements)
    assert plant.dt == two_axes.dt


def test_unwrapped_is_the_machine_and_its_own_state(two_axes, start):
    delayed = Delayed(Saturated(two_axes, jnp.ones(2)), jnp.asarray(1), 2, 2)
    wrapped = LateSensors(
        CountingEncoders(Disturbed(delayed), Sensors(range(2)), 1e-6), jnp.asarray(1), 2
    )
    state = wrapped.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))
    machine, own = unwrapped(wrapped, state)
    assert machine is two_axes
    np.testing.assert_array_equal(own, start)
    np.testing.assert_array_equal(wrapped.output(state), two_axes.output(start))
    assert unwrapped(two_axes, start)[1] is start
