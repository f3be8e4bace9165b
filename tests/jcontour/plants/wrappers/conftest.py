"""Two decoupled axes under random controls, which every wrapper is put around."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest


def _run_any(plant, state, controls):
    def step(state, control):
        return plant.step(state, control), (plant.output(state), plant.measure(state))

    last, (outputs, measurements) = jax.lax.scan(step, state, jnp.asarray(controls))
    return np.asarray(outputs), [np.asarray(leaf) for leaf in jax.tree.leaves(measurements)], last


def _run(plant, state, controls):
    outputs, (measurements,), last = _run_any(plant, state, controls)
    return outputs, measurements, last


@pytest.fixture(scope="session")
def run():
    """(plant, state, controls) -> outputs, measurements and last state."""
    return _run


@pytest.fixture(scope="session")
def run_any():
    """The same for any measurement: its leaves are in a list."""
    return _run_any


@pytest.fixture(scope="session")
def start(two_axes):
    return two_axes.initial_state(jnp.array([1e-3, 2e-3]), jnp.array([1e-5, 0.0]))


@pytest.fixture(scope="session")
def controls():
    return 1e-2 * np.random.default_rng(0).standard_normal((8, 2))


@pytest.fixture(scope="session")
def plain(two_axes, start, controls):
    """The run of the plant without a wrapper."""
    return _run(two_axes, start, controls)
