"""Gantries with friction and engines in a closed loop: what several test files do with them."""

import equinox as eqx
import jax
import numpy as np
import pytest

from jcontour.plants.friction import Friction
from tests.reference_data import numbers_of

DT = 1e-3  # [s] between currents that swing


@pytest.fixture(scope="session")
def rubbing():
    """Friction of a head and two drives, all different."""
    return Friction(
        coulomb=[12.0, 15.0, 19.0],
        stribeck=[6.0, 5.0, 8.0],
        stribeck_speed=[0.02, 0.03, 0.01],
        viscous=[0.0, 3.0, 5.0],
    )


@pytest.fixture(scope="session")
def swinging():
    """(steps, seed, size) -> smooth random currents (T, 3), one a millisecond.

    Through them sliders stick, break loose and turn.
    """

    def currents(steps, seed, size):
        random = np.random.default_rng(seed)
        time = np.arange(steps)[:, None] * DT
        return sum(
            size / k * np.sin(2 * np.pi * k * 8 * time + random.uniform(0, 7, 3)) for k in (1, 2, 3)
        )

    return currents


def _run(plant, start, currents):
    return jax.device_get(_scanned(plant, start, currents))


@eqx.filter_jit
def _scanned(plant, start, currents):
    def step(state, control):
        after = plant.step(state, control)
        return after, (plant.measure(after), after)

    return jax.lax.scan(step, start, currents)[1]


@pytest.fixture(scope="session")
def run():
    """(plant, start, currents) -> what is measured, and the state, after every sample."""
    return _run


@pytest.fixture(scope="session")
def at_rest():
    """(plant, position) -> its state at rest there."""

    def start(plant, position=(0.3, 0.1)):
        return plant.initial_state(np.array(position), np.zeros(2))

    return start


@pytest.fixture(scope="session")
def tools_in_a_loop(gantry_path, gantry_loop):
    """(plant, steps) -> its tool (T, 2) along the reference's path, under its controller."""
    gains, (position, velocity, _) = numbers_of("gantry/closed_loop")["controller"], gantry_path

    def tools(plant, steps=None):
        start, rows = plant.initial_state(position[0], np.zeros(2)), slice(steps)
        run = jax.jit(lambda: gantry_loop(plant, gains, position[rows], velocity[rows], start)[-1])
        return run()

    return tools
