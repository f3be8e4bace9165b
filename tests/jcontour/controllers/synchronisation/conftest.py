"""Reference numbers; the README in tests/data/adaptive explains them."""

import numpy as np
import pytest

from jcontour.controllers.synchronisation.speed_axes import Motion
from tests.reference_data import numbers_of


@pytest.fixture(scope="session")
def synchronisation_numbers():
    """Contents of synchronisation.json."""
    return numbers_of("adaptive/synchronisation")


@pytest.fixture(scope="session")
def stepped():
    """Parameters -> a constant speed, and a load that steps on the second axis."""

    def of(p):
        def load(t):
            return np.array([0.0, p["d2_step"] * (t >= p["t_step"])])

        return Motion(lambda t: p["omega_d"], lambda t: 0.0, load, (p["t_step"],))

    return of
