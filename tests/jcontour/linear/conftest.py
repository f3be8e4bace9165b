"""What several test files do with a linear plant."""

import numpy as np
import pytest


@pytest.fixture(scope="session")
def run():
    """(plant, x, controls) -> states and outputs by NumPy."""

    def states_and_outputs(plant, x, controls):
        A, B, C = (np.asarray(m) for m in (plant.A, plant.B, plant.C))
        states = [np.asarray(x)]
        for u in controls:
            states.append(A @ states[-1] + B @ u)
        return np.array(states), np.array(states) @ C.T

    return states_and_outputs
