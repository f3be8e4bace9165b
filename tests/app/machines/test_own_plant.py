"""A machine around a smooth plant: its linear model, its family, what it refuses."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.files.machine_file import StatedFields
from jcontour.app.files.schema import read
from jcontour.app.machines.own_plant import axes_of, machine_of
from tests.small_loops import Sliding


class Single(Sliding):
    axes: int = 1


def test_a_plant_is_linearised_around_rest():
    model = machine_of(Sliding(), "slide").model
    position, increment = np.array([1.0, 2.0]), np.array([3e-3, 4e-3])  # of 1 ms
    state = model.initial_state(position, increment)
    assert state.tolist() == pytest.approx([1.0, 2.0, 3.0, 4.0])
    after = model.step(state, np.array([5.0, 6.0]))  # 1 kg: 5 mm/s and 5 um more
    assert after.tolist() == pytest.approx([1.003005, 2.004006, 3.005, 4.006])


def after(plant, controls):
    """Positions after these controls, from rest in the origin."""
    state = plant.initial_state(jnp.zeros(2), jnp.zeros(2))
    for control in controls:
        state = plant.step(state, jnp.asarray(control))
    return np.asarray(plant.output(state))


def test_a_family_has_other_gains_and_a_late_plant():
    """The same as scaled and shifted controls on the plant itself."""
    machine = machine_of(Sliding(), "slide")
    assert machine.family_names == ["nominal", "gains 1.1, 0.9", "gains 0.9, 1.1", "1 sample late"]
    assert machine.unknown_delay == 1 and machine.nominal() is machine.plant
    controls = np.array([[300.0, 200.0], [-100.0, 500.0], [50.0, 50.0]])
    wanted = [controls, controls * [1.1, 0.9], controls * [0.9, 1.1], [[0.0, 0.0], *controls[:2]]]
    for plant, moved in zip(machine.true_family(), wanted, strict=True):
        np.testing.assert_allclose(after(plant, controls), after(Sliding(), moved), rtol=1e-12)
    with pytest.raises(ValueError, match="slide is measured as its plant says"):
        machine.smooth_family("state")


def test_random_plants_lie_within_the_stated_uncertainty():
    machine = machine_of(
        Sliding(), "slide", read(StatedFields, {"uncertainty": {"gain": 0.2, "delay": 2}})
    )
    family = machine.random_family(50, seed=1)
    gains, delays = np.asarray(family.gains), np.asarray(family.plant.samples)
    assert 0.15 < np.abs(gains - 1).max() <= 0.2 and gains.shape == (50, 2)
    assert 1.5 < delays.max() <= 2


def test_what_is_assumed_is_said_and_may_be_stated():
    (line,) = machine_of(Sliding(), "slide").remarks
    assert "slide" in line and "10 %" in line and "UNCERTAINTY =" in line
    alone = machine_of(Sliding(), "slide", read(StatedFields, {"uncertainty": {}}))
    assert alone.remarks == [] and alone.family_names == ["nominal"]
    assert alone.random_family(5, 0) is None and alone.unknown_delay == 0
    response = {"hertz": [1.0, 100.0], "relative": [[0.1, 0.2]] * 2}
    assert alone.response_uncertainty is None
    machine = machine_of(
        Sliding(), "slide", read(StatedFields, {"uncertainty": {"response": response}})
    )
    assert machine.response_uncertainty is not None


def test_a_plant_that_says_nothing_has_two_axes():
    assert (axes_of(Sliding()), axes_of(Single())) == (2, 1)


def test_a_plant_may_say_how_many_axes_it_has():
    machine = machine_of(Single(), "slide")
    assert machine.axes == ("X",) and machine.model.inputs == 1 and machine.error == "tracking"
