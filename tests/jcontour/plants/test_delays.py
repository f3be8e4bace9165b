import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.actuation import Delayed, PartlyDelayed


@pytest.mark.parametrize("samples", [0, 1, 2])
def test_delayed_is_the_plant_under_shifted_controls(samples, two_axes, start, controls, run):
    plant = Delayed(two_axes, jnp.asarray(samples), 2, 2)
    state = plant.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))
    outputs, measurements, last = run(plant, state, controls)
    wanted = run(two_axes, start, np.concatenate([np.zeros((samples, 2)), controls])[:8])
    np.testing.assert_allclose(outputs, wanted[0], rtol=1e-14)
    np.testing.assert_allclose(last[0], wanted[2], rtol=1e-14, atol=1e-20)
    np.testing.assert_array_equal(last[1], controls[:-3:-1])
    assert measurements.shape == (8, 4)


def test_delay_line_needs_a_place(two_axes):
    with pytest.raises(ValueError, match="depth"):
        Delayed(two_axes, 0, 0, 2)


@pytest.mark.parametrize("samples", [3, -1])
def test_a_delay_that_the_line_does_not_hold_is_refused(samples, two_axes):
    with pytest.raises(ValueError, match="samples"):
        Delayed(two_axes, samples, 2, 2)


@pytest.mark.parametrize("samples", [0.0, 0.25, 1.0, 1.5, 2.0])
def test_part_of_a_sample_mixes_both_whole_delays(samples, two_axes, controls, run):
    """The plant is linear: its output is mixed as its controls are."""

    def outputs(plant):
        return run(plant, plant.initial_state(np.zeros(2), np.zeros(2)), controls)[0]

    whole = int(np.floor(samples))
    late = [outputs(Delayed(two_axes, jnp.asarray(whole + k), 3, 2)) for k in (0, 1)]
    wanted = (1 - (samples - whole)) * late[0] + (samples - whole) * late[1]
    found = outputs(PartlyDelayed(two_axes, samples, 2, 2))
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-20)


@pytest.mark.parametrize("samples", [2.5, -0.1])
def test_a_partial_delay_that_the_line_does_not_hold_is_refused(samples, two_axes):
    with pytest.raises(ValueError, match="samples"):
        PartlyDelayed(two_axes, samples, 2, 2)
