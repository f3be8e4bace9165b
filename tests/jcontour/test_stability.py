from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.contours import circle, line
from jcontour.controller import Controller
from jcontour.controllers.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers import FilterObserver, PredictorObserver, kalman_gain
from jcontour.linear import LinearPlant, with_input_delay, with_input_gains
from jcontour.plants.wrappers import Delayed, Encoders
from jcontour.references import along
from jcontour.stability import GAIN_RESOLUTION, GAIN_SEARCH, frozen_spectral_radii, frozen_spectral_radius, margins


class Proportional(Controller):
    """u = gain (y_d - x) for an integrator whose state is its position."""

    gain: Any
    preview: int = eqx.field(static=True, default=0)

    def prepare(self, reference):
        return reference.position[: reference.steps]

    def initial_memory(self, reference):
        return None

    def step(self, memory, plan, measurement):
        return None, self.gain * (plan - measurement)


@pytest.fixture(scope="module")
def integrators():
    return LinearPlant(np.eye(2), np.eye(2), np.eye(2), 1e-3)


@pytest.fixture(scope="module")
def straight():
    return along(line([0, 0], [1e-3, 0]), 1e-5 * np.arange(4), 1e-3, 3, at_rest=False)


@pytest.mark.parametrize(("gain", "delay"), [(0.3, 3), (0.7, 0), (0.2, 6)])
def test_margins_of_an_integrator_have_closed_forms(gain, delay, integrators, straight):
    """x+ = x - g u: stable for 0 < g < 2; with d samples of delay for 0 < g < 2 sin(pi / (2 (2 d + 1)))."""
    found = margins(integrators, Proportional(gain), straight)
    assert found.spectral_radius == pytest.approx(max(abs(1 - gain), 0))
    np.testing.assert_allclose(found.gain[:, 1], 2 / gain, rtol=2 * GAIN_RESOLUTION)
    assert (found.gain[:, 0] < 1.06 / GAIN_SEARCH).all()  # any positive gain will do
    limits = [2 * np.sin(np.pi / (2 * (2 * d + 1))) for d in range(20)]
    assert found.delay == max(d for d in range(20) if gain < limits[d]) >= delay


def test_an_unstable_loop_has_no_margin(integrators, straight):
    found = margins(integrators, Proportional(2.5), straight)
    assert (found.spectral_radius, found.delay) == (pytest.approx(1.5), -1)
    np.testing.assert_array_equal(found.gain, 1.0)


@pytest.fixture(scope="module")
def law(two_axes):
    return ContouringLQ(two_axes, LQWeights(3.0, 5.0, 1e-6), 3)


@pytest.fixture(scope="module")
def bent():
    return along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 3, at_rest=False)


def loops(plant, plan):
    """Spectral radius of every frozen loop by NumPy, states fed back."""
    A, B, F = (np.asarray(m) for m in (plant.A, plant.B, plan.F))
    wide = np.concatenate([F, np.zeros((*F.shape[:2], A.shape[0] - F.shape[2]))], axis=2)  # states of a delay line are not fed back
    return np.abs(np.linalg.eigvals(A - B @ wide)).max(axis=1)


def test_frozen_radii_are_eigenvalues_of_a_minus_bf(two_axes, law, bent):
    wanted = loops(two_axes, law.prepare(bent))
    np.testing.assert_allclose(frozen_spectral_radii(two_axes, law, bent), wanted, rtol=1e-9)
    late = Delayed(two_axes, jnp.asarray(2), 2, 2)
    np.testing.assert_allclose(frozen_spectral_radii(late, law, bent), loops(with_input_delay(two_axes, 2), law.prepare(bent)), rtol=1e-7)


def test_frozen_radius_of_a_direction(two_axes, law):
    for direction in ([1.0, 0.0], [-3.0, 4.0]):
        unit = np.array(direction) / np.linalg.norm(direction)
        along_it = along(line([0, 0], 1e-2 * unit), [0.0, 1e-4], 1e-3, 3, at_rest=False)
        assert frozen_spectral_radius(law, np.array(direction)) == pytest.approx(loops(two_axes, law.prepare(along_it))[0], rel=1e-9)
    for bad in ([0.0, 0.0], [np.nan, 1.0], [np.inf, 1.0]):
        with pytest.raises(ValueError, match="direction"):
            frozen_spectral_radius(law, np.array(bad))


@pytest.mark.parametrize("form", [FilterObserver, PredictorObserver])
def test_observers_add_their_own_poles(form, two_axes, law, bent):
    """Separation: the eigenvalues of A - B F and of A - A L C."""
    L = kalman_gain(two_axes, 0.01, 1e-6)
    own = np.abs(np.linalg.eigvals(np.asarray(two_axes.A - two_axes.A @ L @ two_axes.C))).max()
    found = frozen_spectral_radii(Encoders(two_axes), form(law, two_axes, L), bent)
    np.testing.assert_allclose(found, np.maximum(loops(two_axes, law.prepare(bent)), own), rtol=1e-7)


def test_every_loop_is_stable_inside_the_margins_and_one_is_not_outside(two_axes, law, bent):
    found, plan = margins(two_axes, law, bent), law.prepare(bent)
    assert found.spectral_radius == pytest.approx(loops(two_axes, plan).max(), rel=1e-9)
    for axis in range(2):
        low, high = found.gain[axis]
        assert low < 1 < high
        beyond = 1 + 2 * GAIN_RESOLUTION
        for factor, inside in ((high, True), (high * beyond, False), (low, True), (low / beyond, False)):
            if not inside and not 1 / GAIN_SEARCH < factor < GAIN_SEARCH:
                continue  # the search ends there
            gains = np.where(np.arange(2) == axis, factor, 1.0)
            assert (loops(with_input_gains(two_axes, gains), plan).max() < 1) == inside
    assert loops(with_input_delay(two_axes, found.delay), plan).max() < 1
    assert loops(with_input_delay(two_axes, found.delay + 1), plan).max() >= 1


@pytest.mark.parametrize("query", [frozen_spectral_radii, margins])
def test_a_reference_that_does_not_suit_is_refused(query, two_axes, law):
    with pytest.raises(ValueError, match="preview"):
        query(two_axes, law, along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 1, at_rest=False))


def test_an_observer_needs_no_plant_to_be_checked(two_axes, law):
    observer = FilterObserver(law, two_axes, kalman_gain(two_axes, 0.01, 1e-6))
    assert frozen_spectral_radius(observer, np.array([1.0, 0.0])) < 1
