"""A machine around a smooth plant: its linear model, its family, what it refuses."""

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.machines.own_plant import axes_of, machine_of
from jcontour.plant import Plant


class Sliding(Plant):
    """Axes of 1 kg under air drag, v' = u - |v| v; the state is a tuple."""

    dt: float = 1e-3

    def initial_state(self, position, increment):
        return position, increment / self.dt

    def step(self, state, control):
        position, speed = state
        speed = speed + self.dt * (control - speed * jnp.abs(speed))
        return position + self.dt * speed, speed

    def output(self, state):
        return state[0]


class Single(Sliding):
    axes: int = 1


def test_a_plant_is_linearised_around_rest():
    model = machine_of(Sliding(), "slide").model
    position, increment = np.array([1.0, 2.0]), np.array([3e-3, 4e-3])  # of 1 ms
    state = model.initial_state(position, increment)
    assert state.tolist() == pytest.approx([1.0, 2.0, 3.0, 4.0])
    after = model.step(state, np.array([5.0, 6.0]))  # 1 kg: 5 mm/s and 5 um more
    assert after.tolist() == pytest.approx([1.003005, 2.004006, 3.005, 4.006])


def test_the_plant_is_the_whole_family():
    machine = machine_of(Sliding(), "slide")
    (only,) = machine.true_family()
    assert only is machine.plant and machine.family_names == ["nominal"]
    with pytest.raises(ValueError, match="slide is measured as its plant says"):
        machine.smooth_family("state")


def test_a_plant_that_says_nothing_has_two_axes():
    assert (axes_of(Sliding()), axes_of(Single())) == (2, 1)


@pytest.mark.slow
def test_a_plant_may_say_how_many_axes_it_has():
    machine = machine_of(Single(), "slide")
    assert machine.axes == ("X",) and machine.model.inputs == 1 and machine.error == "tracking"
