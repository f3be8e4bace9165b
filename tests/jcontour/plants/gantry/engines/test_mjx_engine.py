import numpy as np
import pytest

from jcontour.plants.gantry.engines.mjx_engine import GantryMJX
from jcontour.plants.gantry.gantry import Gantry

DT = 2e-3


@pytest.mark.slow
def test_a_closed_loop_is_ours(tools_in_a_loop, reference_gantry):
    """From the line into the circle; MuJoCo's own engine runs to the end."""
    engine = tools_in_a_loop(GantryMJX(reference_gantry, DT), 800)
    ours = tools_in_a_loop(Gantry(reference_gantry, DT), 800)
    assert np.ptp(ours, axis=0).min() > 1e-3
    np.testing.assert_allclose(engine, ours, rtol=0, atol=1e-8)
