import numpy as np

from jcontour._arrays import placed
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.plants.wrappers.encoders import Encoders


def test_disturbed_adds_rows_and_holds_the_last(two_axes, start, controls, run):
    random = np.random.default_rng(1)
    force, noise = 1e-3 * random.standard_normal((3, 2)), 1e-6 * random.standard_normal((8, 2))
    plant = Disturbed(Encoders(two_axes), placed(force), placed(noise))
    state = plant.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))
    outputs, measurements, last = run(plant, state, controls)
    wanted = run(two_axes, start, controls + force[np.minimum(np.arange(8), 2)])
    np.testing.assert_allclose(outputs, wanted[0], rtol=1e-14)
    np.testing.assert_allclose(measurements, wanted[0] + noise, rtol=1e-14)
    assert int(last[1]) == 8
