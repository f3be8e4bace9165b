import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.wrappers.saturation import Saturated


def test_saturated_clips_each_control(two_axes, start, controls, run):
    limit = np.array([5e-3, 1.0])
    found = run(Saturated(two_axes, limit), start, controls)
    wanted = run(two_axes, start, np.clip(controls, -limit, limit))
    np.testing.assert_array_equal(found[0], wanted[0])
    assert np.abs(controls[:, 0]).max() > limit[0]


@pytest.mark.parametrize("limit", [[1.0, -1.0], [np.nan, 1.0]])
def test_a_limit_below_zero_is_refused(limit, two_axes):
    with pytest.raises(ValueError, match="limit"):
        Saturated(two_axes, jnp.array(limit))
