"""Filter and responses against a simulated loop of both, and the choice of the filter."""

import numpy as np
import pytest

from jcontour.controllers.observers.kalman import kalman_gain
from jcontour.mpc.bounded.filtered_response import Surroundings, filtered_response
from jcontour.plants import bridgeport
from jcontour.sets.least_peaks import NoResponse

AROUND = Surroundings(force=0.05, encoder=4e-7)
LIMITS = 10.0, np.inf
LENGTH, SAMPLES = 10, 160


@pytest.fixture(scope="module")
def table():
    return bridgeport()


@pytest.fixture(scope="module")
def gains(table):
    return [np.asarray(kalman_gain(table, noise, 2e-7)) for noise in (1e-3, 1e-2, 1e-1)]


@pytest.fixture(scope="module")
def found(table, gains):
    return filtered_response(table, gains, AROUND, LIMITS, LENGTH)


def simulated(table, found, attack):
    """The tool of plant, filter and the policy u(k) = sum_j U_j w(k-j), sample by sample."""
    A, B, C = (np.asarray(matrix) for matrix in (table.A, table.B, table.C))
    sizes = np.abs(found.known.E).max(axis=0) / np.abs(found.gain).max(axis=0)
    controls = found.least.response.control
    x, estimate = np.zeros(table.states), np.zeros(table.states)
    past, tools, innovations = [], [], []
    for force, noise in zip(attack.force, attack.noise, strict=True):
        tools.append(C @ x)
        innovation = C @ x + noise - C @ estimate
        innovations.append(np.abs(innovation) / sizes)
        estimate = estimate + found.gain @ innovation
        past.insert(0, innovation / sizes)
        u = sum(U @ w for U, w in zip(controls, past, strict=False))
        x, estimate = A @ x + B @ (u + force), A @ estimate + B @ u
    return np.array(tools), np.array(innovations)


@pytest.mark.parametrize("direction", [[1.0, 0.0], [0.6, -0.8]])
def test_an_attack_reaches_its_own_sum_and_stays_below_what_is_promised(table, found, direction):
    attack = found.attack(table, AROUND, direction, SAMPLES)
    assert np.abs(attack.force).max() == 0.05 and np.abs(attack.noise).max() == 4e-7
    tools, innovations = simulated(table, found, attack)
    assert innovations.max() <= 1 + 1e-9
    reached = tools[-1] @ direction
    assert 0.3 * found.tolerance < reached < found.tolerance
    for seed in range(20):  # it is the worst of all in the box
        random = np.random.default_rng(seed)
        other = type(attack)(
            0.05 * np.sign(random.normal(size=attack.force.shape)),
            4e-7 * np.sign(random.normal(size=attack.noise.shape)),
        )
        tools, innovations = simulated(table, found, other)
        assert innovations.max() <= 1 + 1e-9
        assert np.abs(tools @ direction).max() <= reached


def test_the_filter_of_the_least_promise_is_taken(table, gains, found):
    alone = [filtered_response(table, [gain], AROUND, LIMITS, LENGTH) for gain in gains]
    best = int(np.argmin([one.tolerance for one in alone]))
    assert found.tolerance == alone[best].tolerance
    np.testing.assert_array_equal(found.gain, gains[best])
    assert found.tolerance == found.least.tolerance + found.missed


def test_speeds_lose_what_the_filter_does_not_know_of_them(table, found):
    kept = found.limits(table, 10.0, 0.2)
    assert [one.limit for one in kept.signals] == pytest.approx(0.2 - found.known.speed)
    assert (found.known.speed > 0).all()


def test_what_cannot_be_answered_is_said(table, gains):
    with pytest.raises(NoResponse, match="control 1 at most 0.01"):
        filtered_response(table, gains, AROUND, (0.01, np.inf), LENGTH)
    with pytest.raises(ValueError, match="speed 1: disturbances alone make"):
        filtered_response(table, gains, AROUND, (10.0, 1e-6), LENGTH)
    with pytest.raises(ValueError, match="gains: needs at least one"):
        filtered_response(table, [], AROUND, LIMITS, LENGTH)
