"""Bounds that are asked for, and machines that have no certificate."""

import pytest

from experiments.catalogue.choices import machine_named
from experiments.machines.disturbance_bounds import bounds_of, linear_machine


def test_bounds_come_from_the_machine_where_none_is_given():
    table = linear_machine(machine_named("xy-table"))
    assert bounds_of(table, None, None) == pytest.approx((0.005, 0.5e-6), rel=1e-12)
    assert bounds_of(table, 0.0, 2.0) == pytest.approx((0.0, 2e-6), rel=1e-12)


@pytest.mark.parametrize(
    ("force", "encoder_um", "words"),
    [(-0.1, None, "force: "), (float("inf"), None, "force: "), (None, -1.0, "encoder-um: a bound"),
     (None, 0.4, "encoder-um: rounding alone errs by half a count, 0.5 um, received 0.4")],
)  # fmt: skip
def test_a_bound_that_is_none_is_told(force, encoder_um, words):
    with pytest.raises(ValueError, match=words):
        bounds_of(linear_machine(machine_named("xy-table")), force, encoder_um)


@pytest.mark.parametrize("name", ["gantry", "flexible-axis"])
def test_a_machine_that_is_not_linear_is_told(name):
    with pytest.raises(ValueError, match=f"plant: {name}.* is not linear"):
        linear_machine(machine_named(name))
