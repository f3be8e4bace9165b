"""An axis that several test files drive."""

import pytest

from jcontour.plants.flexible_axis.axis import AxisParameters
from jcontour.plants.friction import Friction

THESIS = {
    "motor_mass": 39.62,
    "tool_mass": 0.38,
    "stiffness": 2908.0,
    "damping": 2.1,
    "force_constant": 79.33,
    "pole_pitch": 0.0875,
}


@pytest.fixture(scope="session")
def ideal():
    """Changes by name -> the thesis's axis without friction and cogging, but for these changes."""

    def axis(**changes):
        none = Friction(0.0, 0.0, 1.0, 0.0)
        without = {"friction": none, "cogging_sine": [0.0], "cogging_cosine": [0.0]}
        return AxisParameters(**{**THESIS, **without, **changes})

    return axis
