import numpy as np
import pytest

from jcontour.plants.gantry.engines.mjx_engine import GantryMJX
from jcontour.plants.gantry.gantry import Gantry

DT = 2e-3


@pytest.mark.slow
def test_a_closed_loop_is_ours(tools_in_a_loop, reference_gantry):
    """3,365 samples of line, circle, line."""
    engine = tools_in_a_loop(GantryMJX(reference_gantry, DT))
    ours = tools_in_a_loop(Gantry(reference_gantry, DT))
    np.testing.assert_allclose(engine, ours, rtol=0, atol=1e-8)
