"""Bounds that are asked for, and machines that have no certificate."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.analysis.uncertain_loops import Doubt
from jcontour.app.catalogue.choices import machine_named
from jcontour.app.machines.disturbance_bounds import (
    bounds_of,
    box_of,
    linear_machine,
    warn_of_doubt,
)


def test_bounds_come_from_the_machine_where_none_is_given():
    table = linear_machine(machine_named("xy-table"))
    assert bounds_of(table, None, None) == pytest.approx((0.005, 0.5e-6), rel=1e-12)
    rough = replace(table, friction=0.02)
    assert bounds_of(rough, None, None) == pytest.approx((0.02, 0.5e-6), rel=1e-12)
    assert bounds_of(replace(table, friction=0.001), None, None).force == pytest.approx(0.005)
    assert bounds_of(table, 0.0, 2.0) == pytest.approx((0.0, 2e-6), rel=1e-12)


def test_every_encoder_errs_by_half_a_count_of_its_own():
    table = linear_machine(machine_named("xy-table"))
    mixed = replace(table, encoder_resolution=np.array([1e-6, 5e-6]))
    bounds = bounds_of(mixed, None, None)
    assert bounds.encoder == pytest.approx((0.5e-6, 2.5e-6))
    box = box_of(mixed.exact_family()[0], bounds, mixed, "outputs")
    assert box.noise == pytest.approx(np.array([0.5e-6, 2.5e-6]))
    assert bounds_of(mixed, None, 3.0).encoder == pytest.approx(3e-6)
    with pytest.raises(ValueError, match="half a count, 0.5, 2.5 um, received 1"):
        bounds_of(mixed, None, 1.0)


def test_noise_errs_by_three_deviations_beside_half_a_count():
    noisy = replace(linear_machine(machine_named("xy-table")), encoder_noise=np.array([2e-6, 0.0]))
    assert bounds_of(noisy, None, None).encoder == pytest.approx((6.5e-6, 0.5e-6))
    with pytest.raises(ValueError, match="half a count and 3 deviations of noise, 6.5, 0.5 um"):
        bounds_of(noisy, None, 1.0)


def test_friction_that_is_not_known_is_told_where_no_force_is_given():
    rough = replace(linear_machine(machine_named("xy-table")), friction=None)
    assert bounds_of(rough, 0.1, None).force == 0.1  # warnings are errors here
    with pytest.warns(UserWarning, match="its dry friction is not known.*give --force"):
        assert bounds_of(rough, None, None).force == pytest.approx(0.005)


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


def test_a_response_that_is_doubted_is_not_in_the_promise():
    table = linear_machine(machine_named("xy-table"))
    warn_of_doubt(table)  # nothing is doubted; warnings are errors here
    doubted = replace(table, response_doubt=Doubt(np.array([0.1]), np.full((1, 2), 0.2)))
    with pytest.warns(UserWarning, match="uncertainty.response. is not in what is promised"):
        warn_of_doubt(doubted)
