"""Energy of the flexible axis: the work of its forces accounts for every change."""

import jax
import numpy as np
import pytest
from scipy.integrate import simpson

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.motion.point_to_point import thesis_task_a
from jcontour.plants.flexible_axis.axis import FlexibleAxis, Motion, SmoothFlexibleAxis, thesis_axis
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import simulate

DT = 1e-3
K_PP, K_PV, T_IV = 30.0, 55.67, 0.04  # thesis, section 3.4.2


def substep_states(axis, start, currents):
    """Motion (N + 1, 4) and modes at every substep of a run under currents (T,).

    N = T * substeps.
    """
    fine = type(axis)(axis.parameters, axis.dt / axis.substeps, substeps=1)

    def step(state, control):
        after = fine.step(state, control[None])
        return after, after

    _, states = jax.jit(lambda start, u: jax.lax.scan(step, start, u))(
        start, np.repeat(currents, axis.substeps)
    )
    states = jax.tree.map(
        lambda first, rest: np.concatenate([np.asarray(first)[None], rest]), start, states
    )
    motion, mode = (
        (states.motion, states.mode[:, 0])
        if hasattr(states, "motion")
        else (states, np.sign(states.motor_speed[:, 0]))
    )
    return np.concatenate(motion, axis=1), mode


def per_sample(power, axis):
    """Simpson's integral of a power over every sample, from its values at the substeps."""
    windows = np.stack(
        [
            power[k * axis.substeps : (k + 1) * axis.substeps + 1]
            for k in range((len(power) - 1) // axis.substeps)
        ]
    )
    return simpson(windows, dx=axis.dt / axis.substeps, axis=1)


@pytest.mark.parametrize("kind", [FlexibleAxis, SmoothFlexibleAxis])
def test_left_alone_it_loses_its_energy_in_the_damper_only(kind, ideal):
    """Every sample of a second of free motion, to 1e-9 J of about 1 J."""
    axis = kind(ideal(), DT)
    start = Motion(*(np.array([value]) for value in (0.0, 0.2, 0.002, -0.3)))
    if kind is FlexibleAxis:
        start = axis.initial_state(np.zeros(1), np.ones(1))._replace(motion=start)
    x, _ = substep_states(axis, start, np.zeros(1000))
    energy = (39.62 * x[:, 1] ** 2 + 0.38 * x[:, 3] ** 2 + 2908.0 * (x[:, 0] - x[:, 2]) ** 2) / 2
    lost = per_sample(2.1 * (x[:, 1] - x[:, 3]) ** 2, axis)
    change = np.diff(energy[:: axis.substeps])
    np.testing.assert_allclose(change, -lost, rtol=0, atol=1e-9)
    assert np.all(change <= 1e-12) and lost.sum() > 0.02


def test_with_friction_cogging_and_current_the_work_balances():
    """The first half second of task A under the cascade, from stick to cruise.

    Current, cogging, friction and damper account for the energy.
    """
    axis, p = FlexibleAxis(thesis_axis(), DT), thesis_axis()
    run = simulate(axis, Cascade(CascadeGains(K_PP, K_PV, T_IV), motors(1), DT), thesis_task_a())
    currents = np.asarray(run.control)[:500, 0]
    x, mode = substep_states(axis, jax.tree.map(lambda rows: rows[0], run.state), currents)
    np.testing.assert_allclose(
        x[:: axis.substeps][:500],
        np.concatenate(run.state.motion, axis=1)[:500],
        rtol=0,
        atol=1e-13,
    )
    speed, closing = x[:, 1], x[:, 1] - x[:, 3]
    friction = mode * (36.36 + 22.04 / (1 + (speed / 2.82) ** 2)) + 250.9 * speed
    angle = 2 * np.pi / 0.0875 * x[:, 0]
    rows = zip(
        [1, 2, 3], np.asarray(p.cogging_sine)[0], np.asarray(p.cogging_cosine)[0], strict=True
    )
    stored = sum(
        0.0875 / (2 * np.pi * j) * (c * np.sin(j * angle) - s * np.cos(j * angle))
        for j, s, c in rows
    )  # of the cogging
    energy = (
        39.62 * speed**2 + 0.38 * x[:, 3] ** 2 + 2908.0 * (x[:, 0] - x[:, 2]) ** 2
    ) / 2 + stored
    given = 79.33 * currents * np.diff(x[:: axis.substeps, 0])
    balance = (
        np.diff(energy[:: axis.substeps])
        - given
        + per_sample(friction * speed + 2.1 * closing**2, axis)
    )
    assert given.sum() > 2.0
    assert abs(balance.sum()) < 1e-6 * given.sum() and np.abs(balance).max() < 1e-6
