"""A run depends on no place: a shift changes no error, and rest stays rest anywhere.

Laws of every wrapper, and of the controllers that suit drives which take a position: those need
another control at every place. `test_contracts.py` has them on the machines of the catalogue.
"""

import warnings
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.catalogue.choices import UnreadFlagWarning, design_for
from jcontour.app.catalogue.entries import CONTROLLERS, design_class
from jcontour.app.flags.loops import Simulate
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.machines.uncertainty import Uncertainty
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle
from jcontour.host.loop import reported_loop
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.motion.references import along
from jcontour.mpc.tracking.constrained_lq import ConstrainedLQ
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC, TrackingWeights
from jcontour.plant import Remembering, Wrapper
from jcontour.plants.actuation import (
    Backlash,
    Delayed,
    Disturbed,
    ElastoplasticFriction,
    Gained,
    PartlyDelayed,
    Saturated,
    WithDryFriction,
    with_dry_friction,
)
from jcontour.plants.encoders import (
    CountingEncoders,
    Encoders,
    FineEncoders,
    Quantised,
    Sensed,
)
from jcontour.plants.friction import Friction
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import Numbered

STEPS = 5
SHIFT = 1.0  # [m]: whole counts of all encoders
SAME = 1e-9  # [m]
TAKE_A_POSITION = [
    name for name in CONTROLLERS if design_class(name).needs.words.startswith("a machine given")
]


def lags(delay: int = 0) -> LinearPlant:
    """Two drives that follow a commanded position with time constants of 8 and 5 ms, 1 ms."""
    pole, gain = np.exp(-1e-3 / np.array([8e-3, 5e-3])), np.array([2.0, 0.5])
    plant = LinearPlant(np.diag(pole), np.diag(gain * (1 - pole)), np.eye(2), 1e-3)
    return with_input_delay(plant, delay)


def drives() -> LinearMachine:
    weights = {"alpha": 1.0, "beta": 5.0, "rho": 1e-2, "control_noise": 0.1, "drift": 1e-2}
    return LinearMachine(
        "drives",
        lags(1),
        ("X", "Y"),
        "mm",
        MachineLimits(speed=np.full(2, 0.5), acceleration=np.full(2, 50.0)),
        Uncertainty(gain=0.0, delay=1),
        known_delay=1,
        encoder_resolution=5e-6,
        control_noise=0.1,
        published=weights,  # the search for a first loop would take most of the time
    )


@pytest.fixture(scope="session")
def on_drives():
    """Name of a controller -> (plant, controller, steps -> reference), on `drives`."""
    machine = drives()

    def of(name):
        with warnings.catch_warnings():  # not every controller reads all of them
            warnings.simplefilter("ignore", UnreadFlagWarning)
            design = design_for(machine, Simulate(controller=name, preview=3))
        plant = machine.true_family(design.fed)[-1]  # a sample late

        def reference(steps):
            arc = 2.5e-5 * np.arange(steps)
            return along(circle(1e-3), arc, machine.model.dt, design.preview, at_rest=True)

        return plant, design.build(design.start), reference

    return of


def shifted(reference, shift):
    return replace(reference, position=jnp.asarray(reference.position) + shift[None])


def at_rest(reference):
    """The same samples, all at the first place."""
    still = np.repeat(np.asarray(reference.position)[:1], len(reference.position), axis=0)
    start_increment = jnp.zeros(still.shape[1])
    return replace(reference, position=jnp.asarray(still), start_increment=start_increment)


def run(plant, controller, reference):
    """All runs of a controller are one program: it has the start as an argument."""
    begin = eqx.filter_jit(plant.initial_state)
    start = begin(np.asarray(reference.position)[0], reference.start_increment)
    found = simulate(plant, controller, reference, start)
    wanted = np.asarray(reference.position)[: reference.steps]
    return np.asarray(found.output) - wanted, np.asarray(found.control)


@pytest.mark.parametrize("name", TAKE_A_POSITION)
def test_a_controller_of_a_drive_that_takes_a_position_is_the_same_at_any_place(on_drives, name):
    plant, controller, steps = on_drives(name)
    reference, shift = steps(STEPS), np.full(2, SHIFT)
    here, moving = run(plant, controller, reference)
    there, _ = run(plant, controller, shifted(reference, shift))
    np.testing.assert_allclose(there, here, rtol=0, atol=SAME)
    rest = at_rest(shifted(reference, shift))
    error, control = run(plant, controller, rest)
    assert np.abs(error).max() <= SAME
    held = np.broadcast_to(plant.holding_control(rest.position[0]), control.shape)
    rounded = 1e-9 * np.abs(held).max() + 1e-6 * np.abs(moving).max()
    np.testing.assert_allclose(control, held, rtol=0, atol=rounded)


def test_three_forms_of_one_cost_agree_on_a_drive_that_takes_a_position():
    """Gains, a traced program and the host's program weigh the control from where it holds."""
    plant, weights, horizon = lags(), LQWeights(1.0, 5.0, 1e-2), 3
    here = along(circle(1e-3), 2.5e-5 * np.arange(STEPS), plant.dt, horizon, at_rest=True)
    there = shifted(here, np.array([SHIFT, -SHIFT]))
    gains = ContouringLQ(plant, weights, horizon)
    program = ConstrainedLQ(plant, weights, horizon, Limits())
    host = TrackingMPC(plant, TrackingWeights.of(weights), horizon)
    wanted = np.asarray(simulate(plant, gains, there).control)
    for found in (simulate(plant, program, there), reported_loop(plant, host, there).rollout):
        np.testing.assert_allclose(found.control, wanted, rtol=0, atol=1e-8)
    moved = wanted - np.asarray(simulate(plant, gains, here).control)
    held = plant.holding_control(jnp.array([SHIFT, -SHIFT]))
    np.testing.assert_allclose(moved, np.broadcast_to(held, moved.shape), rtol=0, atol=SAME)


def rubbed() -> WithDryFriction:
    return with_dry_friction(lags(), np.asarray(lags().B), np.full(2, 1e-4))


WRAPPED = {
    Backlash: lambda: Backlash(lags(), jnp.full(2, 1e-6)),
    Delayed: lambda: Delayed(lags(), 2, 2, 2),
    PartlyDelayed: lambda: PartlyDelayed(lags(), 0.5, 1, 2),
    Disturbed: lambda: Disturbed(lags(), noise=jnp.ones((1, 2))),
    WithDryFriction: rubbed,
    ElastoplasticFriction: lambda: ElastoplasticFriction(
        lags(), lags().B, lags().C, jnp.ones(2), Friction(np.full(2, 1e-6), 0.0, 1.0, 0.0)
    ),
    Encoders: lambda: Encoders(lags()),
    Sensed: lambda: Sensed(lags(), Sensors([0, 1]).positions),
    Quantised: lambda: Quantised(lags(), 1e-6),
    FineEncoders: lambda: FineEncoders(lags(), Sensors([0, 1])),
    CountingEncoders: lambda: CountingEncoders(lags(), Sensors([0, 1]), 1e-6),
    Gained: lambda: Gained(lags(), np.array([1.1, 0.9])),
    Saturated: lambda: Saturated(lags(), np.full(2, 10.0)),
    Numbered: lambda: Numbered(lags(), 1),
}


def kinds(parent):
    """All classes below it, those that others are made of left out."""
    below = [kind for child in parent.__subclasses__() for kind in (child, *kinds(child))]
    return {kind for kind in below if not kind.__subclasses__()}


def test_no_wrapper_is_left_out():
    ours = {kind for kind in kinds(Wrapper) if kind.__module__.startswith("jcontour")}
    assert ours - {Remembering} == set(WRAPPED)


@pytest.mark.parametrize("kind", WRAPPED)
def test_a_wrapped_drive_is_the_same_at_any_place_and_rests_there(kind):
    """It is pushed by the same change of its control; its outputs move alike."""
    plant, push = WRAPPED[kind](), np.array([1e-3, -2e-3])

    @jax.jit
    def moves(position, push):
        held = plant.holding_control(position)
        state = plant.initial_state(position, jnp.zeros_like(position))
        outputs = [plant.output(state)]
        for _ in range(3):
            state = plant.step(state, held + push)
            outputs.append(plant.output(state))
        return jnp.stack(outputs) - position[None]

    place = np.array([0.25, -0.75])
    here, there = (moves(place + shift, push) for shift in (0.0, SHIFT))
    assert np.abs(here).max() > 1e-5
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-12)
    np.testing.assert_allclose(moves(place + SHIFT, 0 * push), 0.0, rtol=0, atol=1e-12)
