"""Shared by the tests of the library."""

import jaxtyping
import pytest

from jcontour.plants.flexible_axis.axis import AxisParameters, thesis_axis, zoh_model
from jcontour.plants.friction import Friction


@pytest.fixture
def any_type(monkeypatch):
    """Arguments of any type get as far as the library's own checks: no annotation is checked."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


@pytest.fixture(scope="session")
def thesis_model():
    """The thesis's flexible axis without dry friction and cogging, sampled every millisecond."""
    return zoh_model(thesis_axis(), 1e-3)


@pytest.fixture(scope="session")
def two_flexible_axes():
    """Two different axes without dry friction and cogging."""
    drag = Friction(0.0, 0.0, 1.0, [250.9, 100.0])
    return AxisParameters(
        [39.62, 20.0],
        [0.38, 2.0],
        [2908.0, 9e3],
        [2.1, 30.0],
        [79.33, 60.0],
        drag,
        [[0.0]] * 2,
        [[0.0]] * 2,
        [0.1, 0.1],
    )
