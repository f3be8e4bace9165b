"""Two decoupled axes under random controls, which every wrapper is put around."""

import equinox as eqx
import jax
import numpy as np
import pytest


@eqx.filter_jit
def _scanned(plant, state, controls):
    def step(state, control):
        return plant.step(state, control), (plant.output(state), plant.measure(state))

    return jax.lax.scan(step, state, controls)


def _run_any(plant, state, controls):
    last, (outputs, measurements) = jax.device_get(_scanned(plant, state, controls))
    return outputs, jax.tree.leaves(measurements), last


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
    return two_axes.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))


@pytest.fixture(scope="session")
def controls():
    return 1e-2 * np.random.default_rng(0).standard_normal((8, 2))


@pytest.fixture(scope="session")
def plain(two_axes, start, controls):
    """The run of the plant without a wrapper."""
    return _run(two_axes, start, controls)
