"""Bounds told before the first lap: closed forms, and what the laps then do."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import dfreqresp, dlti

from jcontour.arrays import placed
from jcontour.controllers.learning.convergence import (
    convergence,
    frequency_response,
    iteration_sizes,
    worst_of,
)
from jcontour.controllers.learning.laps import Lap, diverged_lap, learn
from jcontour.controllers.learning.norm_optimal import NormOptimal
from jcontour.controllers.learning.p_type import PType

STEPS = 400


def first_order(pole):
    """y(k+1) = p y(k) + (1 - p) u(k), seen one sample ahead."""

    return partial(_response, pole)


@jax.jit
def _response(pole, u):
    return jax.lax.scan(lambda y, u: ((pole * y + (1 - pole) * u),) * 2, jnp.zeros(1), u)[1]


def test_the_response_is_that_of_the_transfer_function():
    w = np.array([0.0, 1e-3, 0.02, 0.7, 2.9, np.pi])
    found = frequency_response(first_order(0.7), (STEPS, 1), 100, w)[:, 0, 0]
    _, wanted = dfreqresp(dlti([0.3, 0.0], [1.0, -0.7], dt=1.0), w)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


@pytest.mark.parametrize(("gain", "bound"), [(1.0, 2 / 3), (2.0, 1.0), (3.0, 2.0), (4.2, 3.2)])
def test_the_bound_of_a_p_type_law(gain, bound):
    """1 - g T: of T = 1 ... 1/3 on the real axis the ends count, at zero and at Nyquist."""
    found = convergence(PType(gain), [first_order(0.5)], (STEPS, 1))
    exact = np.abs(1 - gain * 0.5 / (1 - 0.5 * np.exp(-1j * np.linspace(0, np.pi, 512)))).max()
    assert found.bound == pytest.approx(exact, rel=1e-12)
    assert found.bound == pytest.approx(bound, rel=1e-12)
    assert found.assured is (gain < 2)


def test_the_worst_member_is_named():
    members = [first_order(pole) for pole in (0.2, 0.9, 0.5)]
    found = convergence(PType(1.0), members, (STEPS, 1))
    assert found.member == 1 and found.frequency == pytest.approx(np.pi)


@pytest.mark.parametrize("seed", range(3))
def test_laps_come_closer_by_at_least_the_bound(seed):
    random = np.random.default_rng(seed)
    law, plant = PType(float(random.uniform(0.3, 1.5)), smoothing=2), first_order(0.6)
    bound = convergence(law, [plant], (STEPS, 1)).bound
    wanted = np.convolve(random.standard_normal(STEPS), np.ones(20) / 20, "same")

    def run(u, lap):
        return Lap(u, wanted[:, None] - plant(u), plant(u), u)

    _, limit = learn(run, law, 200, placed(np.zeros((STEPS, 1))))
    found, _ = learn(run, law, 6, placed(np.zeros((STEPS, 1))))
    away = np.linalg.norm((np.asarray(found.correction) - np.asarray(limit))[..., 0], axis=1)
    assert bound < 1 and np.all(away[1:] <= (bound + 1e-9) * away[:-1])


def test_a_norm_optimal_law_on_its_own_model_is_assured():
    """M = effort / (|G|^2 + effort + size), largest where the model answers least."""
    law = NormOptimal(first_order(0.5), np.zeros((STEPS, 1)), 0.0, 0.1, 0.05)
    found = convergence(law, [first_order(0.5)], (STEPS, 1))
    assert found.bound == pytest.approx(0.1 / (1 / 9 + 0.15), rel=1e-10)


def test_a_norm_optimal_law_on_the_opposite_of_its_model_is_not():
    def against(u):
        return -first_order(0.5)(u)

    law = NormOptimal(first_order(0.5), np.zeros((STEPS, 1)), 0.0, 0.1, 0.0)
    found = convergence(law, [first_order(0.5), against], (STEPS, 1))
    assert found.member == 1 and found.bound == pytest.approx((0.1 + 2) / 1.1, rel=1e-10)
    ramp = np.linspace(0.0, 1.0, STEPS)[:, None]

    def run(u, lap):
        return Lap(u, ramp - against(u), against(u), u)

    laps, _ = learn(run, law, 5, placed(np.zeros((STEPS, 1))))
    errors = np.sqrt(np.mean(np.asarray(laps.error) ** 2, axis=(1, 2)))
    assert diverged_lap(errors) == 3


def test_bad_input():
    with pytest.raises(ValueError, match="family: there is no machine in it"):
        convergence(PType(1.0), [], (STEPS, 1))
    with pytest.raises(ValueError, match="places: need to be from 0 to 399, received 400"):
        convergence(PType(1.0), [first_order(0.5)], (STEPS, 1), places=[400])


def test_a_filter_scales_the_sizes_of_the_law_without_it():
    """So that many filters need the responses of the family once."""
    members = [first_order(0.5), first_order(0.8)]
    sizes, frequency = iteration_sizes(PType(0.7, 1), members, (STEPS, 1), (50, 100))
    assert sizes.shape == (2, 2, len(frequency))
    for smoothing in (0, 3, 40):
        whole = convergence(PType(0.7, 1, smoothing), members, (STEPS, 1), (50, 100))
        found = worst_of(sizes * np.cos(frequency / 2) ** (2 * smoothing), frequency)
        assert found.bound == pytest.approx(whole.bound, rel=1e-12)
        assert found[1:] == whole[1:]


def test_what_is_not_finite_is_the_worst():
    sizes = np.array([[[0.5, np.nan], [2.0, 0.1]]])
    assert worst_of(sizes, np.array([0.0, 1.0])) == (np.inf, 0, 1.0)
