"""LQ designs: the observer, the delay of the model, and which weights are free."""

from dataclasses import replace

import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for, machine_named
from jcontour.app.designs.design import picked
from jcontour.app.flags.loops import Simulate
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    PredictorObserver,
)
from tuning.parameters import Fixed

FORMS = {
    "contouring-lq": OffsetFreeObserver,
    "contouring-lq-riccati": OffsetFreeObserver,
    "contouring-lq-kalman": FilterObserver,
    "contouring-lq-predictor": PredictorObserver,
    "preview-lq": OffsetFreeObserver,
}


@pytest.fixture(scope="module")
def machine():
    return machine_named("bridgeport")


@pytest.mark.parametrize("name", FORMS)
def test_the_observer_has_the_form_of_its_name(name, machine):
    design = design_for(machine, Simulate(controller=name, preview=3))
    assert type(design.build(design.start)) is FORMS[name]


def test_the_published_weights_are_the_start(machine):
    """McNab & Tsao, Table 1, case II; the model has no delay and the observer finds no load."""
    design = design_for(machine, Simulate(preview=3))
    start = design.start
    assert tuple(picked("alpha beta rho", start)) == (1.2, 20.0, 2e-9)
    assert design.model.states == machine.model.states and start["drift"] < 1e-5


@pytest.mark.slow
def test_what_is_tuned_predicts_over_the_middle_of_the_unknown_delay(machine):
    """0 to 2 samples: one of them, two states of the delay line."""
    design = design_for(machine, Simulate(preview=3)).tunable()
    assert design.late == 1 and design.model.states == machine.model.states + 2
    assert design.start["alpha"] != 1.2


@pytest.mark.slow
def test_weights_and_delay_that_the_user_sets_stay(machine):
    flags = Simulate(preview=3, alpha=0.05, beta=0.5, model_delay=0)
    design = design_for(machine, flags).tunable()
    assert design.late == 0 and tuple(picked("alpha beta", design.start)) == (0.05, 0.5)


@pytest.mark.parametrize(
    "flags, fault",
    [
        (Simulate(model_delay=3), "may be 0 to 2 samples late"),
        (Simulate(model_delay=-1), "may be 0 to 2 samples late"),
        (Simulate(controller="contouring-lq-state", model_delay=1), "fed the state"),
        (Simulate(preview=0), "preview: needs at least one sample"),
    ],
)
def test_bad_settings_are_told(flags, fault, machine):
    with pytest.raises(ValueError, match=fault):
        design_for(machine, flags)


def test_a_group_frees_its_weights_and_the_others_stay(machine):
    design = design_for(machine, Simulate(preview=3)).freed(["observer", "beta"])
    assert sorted(design.free()) == ["beta", "control_noise", "drift"]
    assert isinstance(design.space["alpha"], Fixed)


def test_a_stage_profile_begins_even(machine):
    design = design_for(machine, Simulate(preview=3)).freed(["alpha", "stage"])
    assert design.free() == ["alpha", "stage"]
    np.testing.assert_array_equal(design.start["stage"], np.ones(3))


def test_an_unknown_weight_is_told_with_the_known_ones(machine):
    design = design_for(machine, Simulate(preview=3))
    with pytest.raises(ValueError, match="no weight 'gamma'; known are alpha, beta"):
        design.freed(["gamma"])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["contouring-lq", "contouring-lq-kalman"])
def test_the_filter_of_each_axis_has_the_noise_of_its_own_encoder(name):
    """On a table whose axes are not coupled its gains are those of tables with equal encoders."""
    table, flags = machine_named("xy-table"), Simulate(controller=name, preview=3)
    start = design_for(table, flags).start | {"control_noise": 0.01}

    def gain(resolution):
        machine = replace(table, encoder_resolution=resolution)
        return np.asarray(design_for(machine, flags).loop.gain(start))

    mixed = gain(np.array([1e-6, 5e-6]))
    for axis, count in enumerate((1e-6, 5e-6)):
        alike = gain(count)[:, axis]
        np.testing.assert_allclose(mixed[:, axis], alike, rtol=1e-6, atol=1e-9 * alike.max())
    assert np.abs(mixed - gain(1e-6)).max() > 0.01 * np.abs(mixed).max()
