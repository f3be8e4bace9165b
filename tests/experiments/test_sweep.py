"""What `jcontour sweep` makes of its flags."""

import pytest

from experiments.catalogue import machine_named
from experiments.options import Sweep
from experiments.sweep import horizons


@pytest.mark.parametrize(
    ("plant", "controller", "found"),
    [
        ("bridgeport", None, (5, 10, 20)),
        ("flexible-axis", "cascade", (1,)),
        ("gantry", "cascade", (1,)),
        ("gantry", "contouring-lq", (5, 10, 20)),
    ],
)
def test_previews_that_differ_are_swept(plant, controller, found):
    assert horizons(Sweep(plant=plant, controller=controller, previews=(5, 10, 20, 10)), machine_named(plant)) == found
