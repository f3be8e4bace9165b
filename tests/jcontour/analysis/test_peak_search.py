"""Peaks over all frequencies."""

import control
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import block_diag

from jcontour.analysis.frequency_response import Encoding
from jcontour.analysis.frozen_loops import FrozenLoop, LinearLaw, LinearMachine
from jcontour.analysis.peak_search import loop_measures
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.plants.actuation import Delayed
from jcontour.plants.encoders import Encoders, FineEncoders
from jcontour.sensors import Sensors, motors
from jcontour.simulation.evaluation import stack_plants
from tests.jcontour.analysis.given_loops import (
    Law,
    loop_peaks,
    peaks_by_control,
    plant_of,
    straight_window,
)


def random_loop(random, axes, states=4):
    """A stable plant and a stable controller whose loop is stable, and not far from the edge."""
    while True:
        A, W = (random.standard_normal((states, states)) for _ in range(2))
        A, W = (0.9 * M / np.abs(np.linalg.eigvals(M)).max() for M in (A, W))
        B, E = (random.standard_normal((states, axes)) for _ in range(2))
        C, K = (random.standard_normal((axes, states)) for _ in range(2))
        K, D = 0.05 * K, 0.05 * random.standard_normal((axes, axes))
        closed = np.block([[A + B @ D @ C, B @ K], [E @ C, W]])
        if 0.6 < np.abs(np.linalg.eigvals(closed)).max() < 0.999:
            return (A, B, C), (W, E, K, D)


@pytest.mark.parametrize("axes", [1, 2])
def test_peaks_are_those_of_python_control(axes):
    random, windows = np.random.default_rng(axes), straight_window(axes)
    for _ in range(3):
        matrices, law = random_loop(random, axes)
        family = stack_plants([Encoders(plant_of(*matrices))])
        actual = loop_peaks(family, Law(*law), windows)
        P, K = control.ss(*matrices, 0, 1e-3), control.ss(*law, 1e-3)
        Ms, Mt = peaks_by_control(P, K).max(axis=0)
        assert actual.sensitivity[0, 0] == pytest.approx(Ms, rel=1e-6)
        assert actual.complementary[0, 0] == pytest.approx(Mt, rel=1e-6)


def test_integrators_have_closed_forms():
    """Ms of x+ = x - g u is 2 / (2 - g), at half the sampling frequency.

    One sample late it is 1 / ((1 - s) sqrt(1 + 2 s)), s = sqrt(g). Mt is 1, at standstill.
    """
    integrators = plant_of(np.eye(2), np.eye(2), np.eye(2))
    family = [Delayed(Encoders(integrators), jnp.asarray(delay), 1, 2) for delay in (0, 1)]
    law = Law.static([[-0.3, 0.0], [0.0, -0.2]])
    actual = loop_peaks(stack_plants(family), law, straight_window(2))
    s = np.sqrt(0.3)
    late = 1 / ((1 - s) * np.sqrt(1 + 2 * s))
    np.testing.assert_allclose(actual.sensitivity[0], [2 / 1.7, late], rtol=1e-9)
    assert actual.complementary[0, 0] == pytest.approx(1, rel=1e-9)
    assert actual.spectral_radius[0, 0] == pytest.approx(0.8, rel=1e-9)


@pytest.mark.parametrize("inside", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("angle", [0.003, 0.7654321, 3.0])
def test_a_narrow_resonance_is_not_missed(inside, angle):
    """S = (z^2 - 2 q cos(a) z + q^2) / (z^2 - 2 r cos(a) z + r^2) with r close to 1."""

    def pair(r):
        return np.array([[2 * r * np.cos(angle), -(r**2)], [1.0, 0.0]])

    opened, closed = 1 - 100 * inside, 1 - inside
    change = (pair(closed) - pair(opened))[:1]
    plant = plant_of(pair(opened), np.array([[1.0], [0.0]]), change)
    law, family = Law.static([[1.0]]), stack_plants([Encoders(plant)])
    actual = loop_peaks(family, law, straight_window(1))
    w = angle + inside * np.linspace(-5, 5, 20001)
    z = np.exp(1j * w)
    numerator, denominator = (
        abs((z - r * np.exp(1j * angle)) * (z - r * np.exp(-1j * angle))) for r in (opened, closed)
    )
    wanted = (numerator / denominator).max()
    assert wanted > 50
    assert actual.sensitivity[0, 0] == pytest.approx(wanted, rel=1e-6 + 1e-16 / inside**2)


def test_speeds_by_difference_change_with_the_positions():
    """A cascade on two coupled axes, where input and output differ, by python-control."""
    A = np.array([[1, 0, 8e-4, 1e-4], [0, 1, 0, 9e-4], [0, 0, 0.6, 0.1], [0, 0, 0, 0.8]])
    B = np.array([[2e-4, 0], [0, 3e-4], [0.4, 0.1], [0, 0.05]])
    dt, k_p, k_v, T_i = 1e-3, np.array([60.0, 15.0]), 0.5, 0.02
    plant = FineEncoders(plant_of(A, B, np.eye(2, 4)), Sensors([0, 1]))
    cascade = Cascade(CascadeGains(k_p, k_v, T_i), motors(2), dt)
    actual = loop_peaks(stack_plants([plant]), cascade, straight_window(2, preview=1))
    z = control.tf([1, 0], [1], dt)
    one, other = (
        control.ss(-k_v * (1 + dt / T_i * z / (z - 1)) * (k + (1 - 1 / z) / dt)) for k in k_p
    )
    peaks = peaks_by_control(control.ss(A, B, np.eye(2, 4), 0, dt), control.append(one, other))
    assert abs(peaks[0] - peaks[1]).max() > 1e-3  # the output does count
    assert actual.sensitivity[0, 0] == pytest.approx(peaks[:, 0].max(), rel=1e-6)
    assert actual.complementary[0, 0] == pytest.approx(peaks[:, 1].max(), rel=1e-6)


def lightly_damped_loop(random):
    """A stable loop of an integrator with up to five light modes, late, under a slow PI law."""
    while True:
        parts, B, C = [np.eye(1)], [1.0], [1.0]
        for _ in range(random.integers(1, 6)):
            w, damping = np.exp(random.uniform(-6, 1)), 10 ** random.uniform(-4, -0.5)
            cos, sin = np.cos(w), np.sin(w)
            parts.append(np.exp(-damping * w) * np.array([[cos, -sin], [sin, cos]]))
            size, turn = 0.1 * w * 10 ** random.uniform(-3, 1), random.uniform(0, 2 * np.pi)
            B, C = [*B, 1.0, 0.0], [*C, size * np.cos(turn), size * np.sin(turn)]
        A, B, C = block_diag(*parts), np.array(B)[:, None], np.array([C])
        late = random.integers(0, 30)
        states = len(A)
        A = block_diag(A, np.eye(late, k=-1))
        if late:
            A[states, :states] = C[0]
        B = np.pad(B, ((0, late), (0, 0)))
        C = np.eye(1, states + late, states + late - 1) if late else C
        gain = 10 ** random.uniform(-4, -0.3)
        slow = gain * 10 ** random.uniform(-4, -1)
        law = LinearLaw(np.eye(1), np.eye(1), np.array([[-slow]]), np.array([[-gain]]))
        loop = FrozenLoop(LinearMachine(A, B, C), law)
        closed = np.block([[A - gain * B @ C, -slow * B], [C, np.eye(1)]])
        if np.abs(np.linalg.eigvals(closed)).max() < 1 - 1e-9:
            return loop, closed, np.concatenate([B[:, 0], [0.0]]), np.append(-gain * C[0], -slow)


def searched_peaks(closed, entry, leave):
    """Peaks of |1 + T| and |T| by residues, on some 30,000 frequencies, refined three times."""
    poles, vectors = np.linalg.eig(closed)
    residues = np.linalg.solve(vectors, entry.astype(complex)) * (leave @ vectors)
    near = np.abs(np.angle(poles))[:, None] + (1 - np.abs(poles))[:, None] * np.linspace(
        -20, 20, 801
    )
    w = np.concatenate(
        [np.linspace(0, np.pi, 20001)[1:], np.geomspace(1e-6, 1, 4001), near.ravel()]
    )
    w = np.unique(np.clip(w, 1e-9, np.pi))

    def size(w, direct):
        return np.abs(direct + (residues / (np.exp(1j * w)[:, None] - poles)).sum(axis=-1))

    for direct in (1, 0):
        heights, best = size(w, direct), 0.0
        for k in np.argsort(-heights)[:10]:
            low, high = w[max(k - 1, 0)], w[min(k + 1, len(w) - 1)]
            for _ in range(3):
                fine = np.linspace(low, high, 101)
                top = int(np.argmax(size(fine, direct)))
                best = max(best, size(fine, direct)[top])
                low, high = fine[max(top - 1, 0)], fine[min(top + 1, 100)]
        yield best


@pytest.mark.parametrize("seed", range(2))
def test_peaks_of_lightly_damped_late_loops_are_found_to_a_thousandth(seed):
    random = np.random.default_rng(seed)
    nothing = Encoding(np.zeros((0, 1)), np.zeros((1, 0)), np.zeros((1, 0)))
    for _ in range(12):
        loop, *whole = lightly_damped_loop(random)
        actual, _ = loop_measures(jax.tree.map(lambda matrix: matrix[None], loop), nothing)
        np.testing.assert_allclose(actual[0, :2], list(searched_peaks(*whole)), rtol=1e-3)
