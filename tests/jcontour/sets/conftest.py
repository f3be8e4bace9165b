"""Shared by the tests of sets: the thesis's axis, and a slide."""

import numpy as np
import pytest

from jcontour.sets.responses import DisturbedModel
from tests.reference_data import numbers_of


@pytest.fixture(scope="session")
def axis_numbers():
    return numbers_of("guarantees/axis")


@pytest.fixture(scope="session")
def axis(axis_numbers):
    """The thesis's axis in error coordinates; its reference is known."""
    return DisturbedModel.of(*(np.array(axis_numbers[name]) for name in "ABE"))


@pytest.fixture(scope="session")
def slide():
    """A mass of 1 kg on a spring of 9 N/m, sampled every 0.1 s by forward Euler, under 0.2 N."""
    dt = 0.1
    return DisturbedModel.of([[1, dt], [-9 * dt, 1]], [0, dt], [0, 0.2 * dt])
