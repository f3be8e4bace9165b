"""Commissionings of the thesis's axis, simulated once."""

import pytest

from jcontour.plants.flexible_axis.axis import thesis_axis
from jcontour.plants.flexible_axis.linear_motor import thesis_motor
from tuning.identification.flexible_axis.axis import identify
from tuning.identification.flexible_axis.commissioning import Commissioning


@pytest.fixture(scope="session")
def records():
    """Electrical test, sweep and moves with the usual instruments."""
    return Commissioning(thesis_axis(), thesis_motor(), seed=1).thesis_tests()


@pytest.fixture(scope="session")
def found(records):
    """What they say."""
    return identify(records)
