import numpy as np
import pytest

from jcontour.qp.hildreth import ascent


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_multipliers_that_only_fall_are_climbed_to_their_end(side):
    """The free minimum lies beyond both limits at zero: z = 0, with multipliers -g.

    Both rise, or both fall, by a quarter of what is left in every sweep.
    """
    H, g = np.linalg.inv([[1.0, -0.5], [-0.5, 1.0]]), -side * np.array([2.0, 3.0])
    low, high = (-np.inf, 0.0) if side > 0 else (0.0, np.inf)
    z, multipliers, sweeps = ascent(
        H, g, np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.full(2, low), np.full(2, high)
    )
    np.testing.assert_allclose(z, 0.0, atol=1e-12)
    np.testing.assert_allclose(multipliers, -g, rtol=1e-11)
    assert 10 < sweeps < 40
