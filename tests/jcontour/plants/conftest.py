"""Gantries that several test files drive.

Two decoupled axes under random controls, which every wrapper is put around.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.gantry.gantry import GantryParameters
from tests.reference_data import numbers_of

NAMES = {
    "drive_mass_1": "M_1",
    "drive_mass_2": "M_2",
    "beam_mass": "M_n",
    "head_mass": "M_e",
    "half_span": "L",
    "joint_length": "l",
    "half_width": "w_N",
    "tool_offset": "d",
    "joint_stiffness": "k_r",
    "lateral_stiffness": "k_s",
    "head_constant": "k_x",
    "drive_constant": "k_y",
    "head_viscous": "b_x",
    "drive_viscous": "b_y",
}


@pytest.fixture(scope="session")
def reference_gantry():
    """The machine of the reference data."""
    return GantryParameters(
        **{name: numbers_of("gantry/samples")["params"][letter] for name, letter in NAMES.items()}
    )


@pytest.fixture(scope="session")
def odd_gantry():
    """Another machine: unequal drives, short and soft, its tool on the other side of the beam."""
    return GantryParameters(
        drive_mass_1=13.0,
        drive_mass_2=31.0,
        beam_mass=52.0,
        head_mass=17.0,
        half_span=0.6,
        joint_length=0.05,
        half_width=0.1,
        tool_offset=-0.13,
        joint_stiffness=9e5,
        lateral_stiffness=4e5,
        head_constant=35.0,
        drive_constant=80.0,
        head_viscous=90.0,
        drive_viscous=310.0,
    )


@pytest.fixture(scope="session")
def gantry_path():
    """Line, circle, line of the reference data.

    Position and velocity at every sample, and which samples lie on the circle.
    """
    data, dt = numbers_of("gantry/closed_loop"), 2e-3
    R, line, v, a, T = (data["path"][key] for key in ("R", "line", "v", "a", "T"))
    steps = data["closed_loop"]["steps"]
    time, ramp = np.minimum(np.arange(steps + 1) * dt, T), v / a
    total = 2 * line + 2 * np.pi * R
    arc = np.where(time < ramp, a * time**2 / 2, v * (time - ramp / 2))
    arc = np.where(time > T - ramp, total - a * (T - time) ** 2 / 2, arc)
    angle = (arc - line) / R
    on_circle = (angle > 0) & (angle < 2 * np.pi)
    straight = np.where(angle <= 0, arc - line, arc - line - 2 * np.pi * R)
    position = np.where(
        on_circle,
        R * np.array([np.cos(angle), np.sin(angle)]),
        np.array([np.full_like(arc, R), straight]),
    ).T
    return position[:-1], np.diff(position, axis=0) / dt, on_circle[:-1]


@pytest.fixture(scope="session")
def gantry_loop():
    """(plant, gains, position, velocity, start) -> final state, states, currents and tools.

    Under the reference's controller.
    """

    def proportional(parameters, gains, wanted, speed, state):
        x, y, _, dx, dy, _ = state
        along = (
            gains["kpx"] * (wanted[0] - x)
            + gains["kdx"] * (speed[0] - dx)
            + parameters.head_viscous * speed[0]
        )
        across = gains["kpy"] * (wanted[1] + parameters.tool_offset - y) + gains["kdy"] * (
            speed[1] - dy
        )
        across = (across + 2 * parameters.drive_viscous * speed[1]) / (
            2 * parameters.drive_constant
        )
        return jnp.clip(
            jnp.stack([along / parameters.head_constant, across, across]),
            -gains["u_max"],
            gains["u_max"],
        )

    def loop(plant, gains, position, velocity, start):
        def step(state, row):
            control = proportional(plant.parameters, gains, *row, plant.measure(state))
            return plant.step(state, control), (state, control, plant.output(state))

        final, rows = jax.lax.scan(step, start, (position, velocity))
        return final, *rows

    return loop


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
