"""Continuous synchronisation against reference numbers and against the matrix exponential."""

import numpy as np
import pytest
from scipy.linalg import expm

from jcontour.controllers.synchronisation.speed_axes import (
    ContinuousGains,
    Motion,
    continuous_response,
    coupling_matrix,
    speed_axes,
)


def gains_of(p, beta):
    return ContinuousGains(np.array(p["kc"]), p["gamma_c"], float(beta), p["v_c"])


@pytest.mark.parametrize("name", ["sync_nominal", "sync_low_kc"])
def test_a_step_of_load(synchronisation_numbers, stepped, name):
    reference = synchronisation_numbers[name]
    p = reference["parameters"]
    times = np.linspace(p["t_step"], p["t_end"], 2401)
    axes = speed_axes(p["a"], p["b"])
    for row in reference["continuous"]:
        run = continuous_response(axes, gains_of(p, row["beta"]), stepped(p), times)
        apart = run.error[:, 0] - run.error[:, 1]
        found = [
            np.abs(apart).max(),
            np.trapezoid(np.abs(apart), times),
            *np.abs(run.error).max(axis=0),
            np.abs(apart[-1]),
        ]
        keys = ("peak_sync", "iae_sync", "peak_e1", "peak_e2", "final_sync")
        np.testing.assert_allclose(found, [row[key] for key in keys], rtol=0, atol=1e-9)


def test_a_speed_that_moves(synchronisation_numbers, stepped):
    reference = synchronisation_numbers["sync_time_varying"]
    p = synchronisation_numbers["sync_nominal"]["parameters"]
    size, frequency = reference["wave"]
    turn = 2 * np.pi * frequency
    motion = Motion(
        lambda t: 1 + size * np.sin(turn * t),
        lambda t: size * turn * np.cos(turn * t),
        *stepped(p)[2:],
    )
    gains = gains_of(p, reference["beta"])
    run = continuous_response(speed_axes(p["a"], p["b"]), gains, motion, np.array(reference["t"]))
    np.testing.assert_allclose(run.error[:, 0], reference["e1"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.error[:, 1], reference["e2"], rtol=0, atol=1e-9)
    theta = run.estimate[-1].ravel()
    np.testing.assert_allclose(theta, reference["theta_end_continuous"], rtol=0, atol=1e-9)


def test_unequal_axes_against_the_matrix_exponential():
    """With a steady speed and load all is linear: e' = -(A + B k C) e - B s, s' = g |phi|^2 C e."""
    axes, k, g, beta, bias = speed_axes([10.0, 4.0], [50.0, 70.0]), (0.3, 0.5), 8.0, 1.5, 0.7
    load = np.array([0.2, -0.4])
    motion = Motion(lambda t: 1.3, lambda t: 0.0, lambda t: load)
    times = np.linspace(0.0, 0.8, 17)
    run = continuous_response(axes, ContinuousGains(np.array(k), g, beta, bias), motion, times)
    B, C = np.diag(axes.gain), coupling_matrix(beta)
    F = -np.diag(axes.pole) - B @ np.diag(k) @ C
    M = np.block([[F, -B], [g * (1.3**2 + bias**2) * C, np.zeros((2, 2))]])
    start = np.concatenate([np.zeros(2), load])
    wanted = np.array([expm(M * t) @ start for t in times])
    np.testing.assert_allclose(run.error, wanted[:, :2], rtol=0, atol=1e-10)


def test_bad_input():
    axes, gains = speed_axes([10.0, 10.0], 50.0), ContinuousGains(np.ones(2), 1.0, 0.0)
    still = Motion(lambda t: 1.0, lambda t: 0.0, lambda t: np.zeros(2))
    for times in ([], [-1.0, 0.0], [1.0, 1.0]):
        with pytest.raises(ValueError, match="times: need to increase"):
            continuous_response(axes, gains, still, np.array(times))
    with pytest.raises(ValueError, match="axes: synchronisation needs two"):
        continuous_response(speed_axes(10.0, 50.0), gains, still, np.array([0.0]))
