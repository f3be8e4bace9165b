"""What `jcontour sweep` makes of its flags."""

import numpy as np
import pytest

from experiments.catalogue.choices import design_for, machine_named
from experiments.commands.sweep import horizons, sampled_values
from experiments.options import Sweep


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
    assert (
        horizons(
            Sweep(plant=plant, controller=controller, previews=(5, 10, 20, 10)),
            machine_named(plant),
        )
        == found
    )


@pytest.mark.parametrize(
    ("plant", "controller", "middle"),
    [
        ("bridgeport", None, {"alpha": 1.2, "beta": 20.0}),
        ("gantry", "contouring-lq", {"alpha": 1e8, "beta": 1e9}),
        (
            "gantry",
            "cascade",
            {"position": 30.0, "integral_time": 0.05},
        ),  # the velocity gain of X is not that of Y
    ],
)
def test_what_varies_lies_around_the_start(plant, controller, middle):
    flags = Sweep(plant=plant, controller=controller)
    values = sampled_values(flags, design_for(machine_named(plant), flags))
    assert {name: float(np.median(column)) for name, column in values.items()} == middle
    assert all(
        column.size == 25 and column.max() == pytest.approx(100 * column.min())
        for column in values.values()
    )


def test_what_varies_can_be_named():
    flags = Sweep(vary=("alpha=1,2", "beta=0,5,20"))
    values = sampled_values(flags, design_for(machine_named("bridgeport"), flags))
    assert sorted(zip(*map(np.ndarray.tolist, map(np.asarray, values.values())), strict=True)) == [
        (1, 0),
        (1, 5),
        (1, 20),
        (2, 0),
        (2, 5),
        (2, 20),
    ]
