"""Cascades and feedforward of linear machines: margins, closed forms, errors and bad input."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for
from jcontour.app.catalogue.entries import MACHINES
from jcontour.app.designs.feedforward import axes_of
from jcontour.app.designs.lq.first_loop import sensitivity_peaks, straight_windows
from jcontour.app.flags.loops import Simulate
from jcontour.simulation.evaluation import stack_plants


@pytest.fixture(scope="module", params=["bridgeport", "xy-table"])
def machine(request):
    return MACHINES[request.param]()


def design(machine, name, **flags):
    return design_for(machine, Simulate(controller=name, **flags))


@pytest.mark.slow
def test_the_first_cascade_keeps_the_margin(machine):
    found = design(machine, "cascade")
    family = stack_plants(machine.smooth_family())
    gains = {name: jnp.asarray(value)[None] for name, value in found.start.items()}
    peaks = sensitivity_peaks(found.build, gains, family, straight_windows(machine, 1))
    assert 1.2 < float(np.max(peaks)) <= 2.0


@pytest.mark.slow
def test_motion_feedforward_is_the_inverse_of_slow_motion(machine):
    """The control that holds a speed, by a long run under a constant control."""
    found = design(machine, "cascade-feedforward")
    state = machine.model.initial_state(jnp.zeros(2), jnp.zeros(2))
    outputs = []
    for _ in range(3000):
        state = machine.model.step(state, jnp.ones(2))
        outputs.append(np.asarray(machine.model.output(state)))
    speed = (outputs[-1] - outputs[-2]) / machine.model.dt
    np.testing.assert_allclose(found.start["viscous"], 1 / speed, rtol=1e-4)
    # y(t) = speed (t - lag): the lag is inertia over viscous friction
    lag = 3000 * machine.model.dt - outputs[-1] / speed
    np.testing.assert_allclose(found.start["inertia"] / found.start["viscous"], lag, rtol=2e-2)


@pytest.mark.slow
def test_alias_preview_and_delay():
    bridgeport = MACHINES["bridgeport"]()
    assert design(bridgeport, "cascade").name == "linear-cascade"
    assert design(bridgeport, "optimal-feedforward", preview=6).preview == 6
    late, early = (design(bridgeport, "zpetc", model_delay=d).preview for d in (2, 0))
    assert late == early + 2
    with pytest.raises(ValueError, match="may be 0 to 2 samples late"):
        design(bridgeport, "zpetc", model_delay=3)
    with pytest.raises(ValueError, match="needs at least the plant's delay of 2 samples"):
        design(bridgeport, "optimal-feedforward", preview=1)


@pytest.mark.slow
def test_free_numbers_of_feedforward_are_tuned_with_those_of_the_feedback():
    found = design(MACHINES["bridgeport"](), "optimal-feedforward")
    names = {"position", "velocity", "integral_time", "smoothing", "weight"}
    assert set(found.free()) == names
    found.check_start()
    assert found.freed(["smoothing"]).free() == ["smoothing"]


def test_coupled_axes_are_refused(coupled_plant):
    with pytest.raises(ValueError, match="needs axes with one control each"):
        axes_of(coupled_plant(0, 4, 2))
