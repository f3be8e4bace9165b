"""Bounds known before the first lap: closed forms, and what the laps then do."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from jcontour._arrays import placed
from jcontour.controllers.learning.laps import (
    Lap,
    PType,
    diverged_lap,
    impulse_responses,
    learn,
)
from jcontour.controllers.learning.norm_optimal import NormOptimal

STEPS = 400
ABOVE = 1.0013  # of the maximum, at most, where a bound may be


def convergence(*law_family_shape):
    return impulse_responses(*law_family_shape).convergence()


def first_order(pole):
    """y(k+1) = p y(k) + (1 - p) u(k), seen one sample ahead."""

    return partial(_response, pole)


@jax.jit
def _response(pole, u):
    return jax.lax.scan(lambda y, u: ((pole * y + (1 - pole) * u),) * 2, jnp.zeros(1), u)[1]


@pytest.mark.parametrize(("gain", "bound"), [(1.0, 2 / 3), (2.0, 1.0), (3.0, 2.0), (4.2, 3.2)])
def test_the_bound_of_a_p_type_law(gain, bound):
    """1 - g T: of T = 1 ... 1/3 on the real axis the ends count, at zero and at Nyquist."""
    actual = convergence(PType(gain), [first_order(0.5)], (STEPS, 1))
    assert bound - 1e-12 <= actual.estimate <= ABOVE * bound
    assert actual.invariant


def answering(h):
    """Convolution with an impulse response as long as the lap."""
    both = 2 * len(h)
    H = placed(np.fft.rfft(h, both)[:, None])

    def linear(c):
        return jnp.fft.irfft(H * jnp.fft.rfft(c, both, axis=0), both, axis=0)[: len(c)]

    return linear


def resonant(steps, direct, gain, pole):
    """Impulse response of direct - gain Re(1 / (1 - pole / z))."""
    k = np.arange(steps)
    h = -gain * np.abs(pole) ** k * np.cos(np.angle(pole) * k)
    h[0] += direct
    return h


def highest(direct, gain, pole):
    """Maximum of |1 - H| around the angle of the pole, by a search of its own."""

    def size(w):
        z = np.exp(1j * w)
        H = direct - gain * 0.5 * (1 / (1 - pole / z) + 1 / (1 - np.conj(pole) / z))
        return np.abs(1 - H)

    angle, width = np.angle(pole), 50 * (1 - np.abs(pole))
    fine = angle + np.linspace(-width, width, 20001)
    top = fine[np.argmax(size(fine))]
    step = fine[1] - fine[0]
    actual = minimize_scalar(
        lambda w: -size(w),
        bounds=(top - step, top + step),
        method="bounded",
        options={"xatol": 1e-12},
    )
    return max(size(top), -actual.fun)


def test_a_resonance_between_the_frequencies_of_a_grid_is_in_the_bound():
    """One so narrow that 512 frequencies miss it; the laps get worse, as the bound says."""
    w0, steps = 1.0482222, 8000
    r = np.exp(-0.002 * w0)
    h = resonant(steps, 0.9, 2.1 * (1 - r), r * np.exp(1j * w0))
    actual = convergence(PType(1.0), [answering(h)], (steps, 1))
    wanted = highest(0.9, 2.1 * (1 - r), r * np.exp(1j * w0))
    assert wanted == pytest.approx(1.151, abs=5e-4)
    assert wanted <= actual.estimate <= ABOVE * wanted
    assert actual.invariant and actual.frequency == pytest.approx(w0, abs=1e-3)
    error = np.cos(w0 * np.arange(steps))
    sizes = [np.linalg.norm(error)]
    for _ in range(8):
        error = error - lfilter(h, 1, error)
        sizes.append(np.linalg.norm(error))
    assert sizes[-1] > 1.5 * sizes[0]


@pytest.mark.parametrize("seed", range(12))
def test_the_bound_is_above_the_maximum_of_random_lightly_damped_loops(seed):
    random = np.random.default_rng(seed)
    pole = (1 - 10 ** random.uniform(-2.5, -1.5)) * np.exp(1j * random.uniform(0.1, 3.0))
    gain = random.uniform(1.0, 5.0) * (1 - np.abs(pole))
    h = resonant(8192, 0.9, gain, pole)
    actual = convergence(PType(1.0), [answering(h)], (len(h), 1))
    wanted = highest(0.9, gain, pole)
    assert wanted - 1e-6 <= actual.estimate <= ABOVE * wanted


def test_two_axes_that_are_coupled():
    """Largest singular value of I - H, H = H_1 R with a constant matrix R."""
    R = np.array([[1.0, 0.4], [-0.2, 0.8]])
    h = resonant(512, 0.5, 0.1, 0.9 * np.exp(0.7j))
    one = answering(h)
    actual = convergence(PType(1.0), [lambda c: one(c @ R.T)], (512, 2))
    H = np.fft.rfft(h, 2**16)[:, None, None] * R
    wanted = np.linalg.norm(np.eye(2) - H, 2, axis=(1, 2)).max()
    assert wanted - 1e-9 <= actual.estimate <= ABOVE * wanted


def test_a_loop_that_changes_along_the_lap_has_an_estimate_and_no_bound():
    gains = placed(np.linspace(0.5, 1.0, STEPS)[:, None])
    actual = convergence(PType(1.0), [lambda c: gains * c], (STEPS, 1))
    assert actual.estimate == pytest.approx(1 - float(gains[STEPS // 4, 0]), rel=2e-3)
    assert not actual.invariant


def test_the_worst_member_is_named():
    members = [first_order(pole) for pole in (0.2, 0.9, 0.5)]
    actual = convergence(PType(1.0), members, (STEPS, 1))
    assert actual.member == 1 and actual.frequency == pytest.approx(np.pi)


@pytest.mark.parametrize("seed", range(3))
def test_laps_come_closer_by_at_least_the_bound(seed):
    random = np.random.default_rng(seed)
    law, plant = PType(float(random.uniform(0.3, 1.5)), smoothing=2), first_order(0.6)
    bound = convergence(law, [plant], (STEPS, 1)).estimate
    wanted = np.convolve(random.standard_normal(STEPS), np.ones(20) / 20, "same")

    def run(u, lap):
        return Lap(u, wanted[:, None] - plant(u), plant(u), u)

    _, limit = learn(run, law, 200, placed(np.zeros((STEPS, 1))))
    actual, _ = learn(run, law, 6, placed(np.zeros((STEPS, 1))))
    away = np.linalg.norm((np.asarray(actual.correction) - np.asarray(limit))[..., 0], axis=1)
    assert bound < 1 and np.all(away[1:] <= (bound + 1e-9) * away[:-1])


def test_a_norm_optimal_law_on_its_own_model_is_assured():
    """M = effort / (|G|^2 + effort + size), largest where the model answers least."""
    law = NormOptimal(first_order(0.5), np.zeros((STEPS, 1)), 0.0, 0.1, 0.05)
    actual = convergence(law, [first_order(0.5)], (STEPS, 1))
    wanted = 0.1 / (1 / 9 + 0.15)
    assert wanted - 1e-9 <= actual.estimate <= ABOVE * wanted


def test_a_norm_optimal_law_on_the_opposite_of_its_model_is_not():
    def against(u):
        return -first_order(0.5)(u)

    law = NormOptimal(first_order(0.5), np.zeros((STEPS, 1)), 0.0, 0.1, 0.0)
    actual = convergence(law, [first_order(0.5), against], (STEPS, 1))
    wanted = (0.1 + 2) / 1.1
    assert actual.member == 1 and wanted - 1e-9 <= actual.estimate <= ABOVE * wanted
    ramp = np.linspace(0.0, 1.0, STEPS)[:, None]

    def run(u, lap):
        return Lap(u, ramp - against(u), against(u), u)

    laps, _ = learn(run, law, 5, placed(np.zeros((STEPS, 1))))
    errors = np.sqrt(np.mean(np.asarray(laps.error) ** 2, axis=(1, 2)))
    assert diverged_lap(errors) == 3


def test_bad_input():
    with pytest.raises(ValueError, match="family: there is no machine in it"):
        convergence(PType(1.0), [], (STEPS, 1))
    with pytest.raises(ValueError, match="shape: needs a lap of at least eight samples"):
        convergence(PType(1.0), [first_order(0.5)], (7, 1))


def test_a_filter_scales_the_sizes_of_the_law_without_it():
    """So that many filters need the answers of the family once."""
    members = [first_order(0.5), first_order(0.8)]
    known = impulse_responses(PType(0.7, 1), members, (STEPS, 1), smoothing=40)
    for smoothing in (0, 3, 40):
        whole = convergence(PType(0.7, 1, smoothing), members, (STEPS, 1))
        actual = known.convergence(smoothing)
        assert actual.estimate == pytest.approx(whole.estimate, rel=2e-3)
        assert actual.member == whole.member


def test_what_is_not_finite_is_the_worst():
    actual = convergence(PType(1.0), [first_order(0.5), lambda c: c / 0], (STEPS, 1))
    assert actual.member == 1 and actual.estimate == np.inf
