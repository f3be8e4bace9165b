"""The self-tuning servo against reference numbers and against its polynomial."""

from functools import cache

import control
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.frozen_loops import frozen_loop
from jcontour.controllers.feedback.pole_placement import (
    Estimate,
    SelfTuning,
    damped_poles,
    placed_gain,
    placed_gains,
)
from jcontour.geometry.contours import line
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import from_samples
from jcontour.plant import Plant
from jcontour.plants.encoders import Encoders
from jcontour.plants.flexible_axis.axis import zoh_model
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate
from tests.reference_data import numbers_of

DT = 1e-3
pairs = jax.jit(damped_poles, static_argnums=2)


@cache
def two_pairs():
    return pairs(np.array([40.0, 95.0]), np.array([0.9, 0.3]), DT)


def moved(model, K):
    return np.sort_complex(np.linalg.eigvals(np.asarray(model.A) - np.asarray(model.B) @ K))


def test_poles_are_where_they_were_asked_for_and_the_gain_that_of_python_control(thesis_model):
    K = placed_gain(thesis_model, two_pairs())
    np.testing.assert_allclose(
        moved(thesis_model, K), np.sort_complex(two_pairs()), rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(
        K,
        control.place(
            np.asarray(thesis_model.A), np.asarray(thesis_model.B), np.asarray(two_pairs())
        ),
        rtol=1e-9,
    )


def test_pairs_are_those_of_the_continuous_oscillator():
    s = np.roots([1.0, 2 * 0.3 * 95.0, 95.0**2])
    np.testing.assert_allclose(
        np.sort_complex(pairs(95.0, 0.3, DT)), np.sort_complex(np.exp(s * DT)), rtol=1e-14
    )


def test_equal_real_poles_make_a_dead_beat(thesis_model):
    K = placed_gain(thesis_model, np.zeros(4))
    assert (
        np.abs(np.linalg.matrix_power(np.asarray(thesis_model.A - thesis_model.B @ K), 4)).max()
        < 1e-4 * np.abs(thesis_model.B @ K).max()
    )


def test_axes_side_by_side_each_have_their_own(two_flexible_axes):
    model, others = zoh_model(two_flexible_axes, DT), damped_poles([30.0, 60.0], [0.7, 0.7], DT)
    K = placed_gain(model, np.stack([two_pairs(), others]))
    np.testing.assert_allclose(
        moved(model, K), np.sort_complex(np.concatenate([two_pairs(), others])), rtol=0, atol=1e-9
    )
    np.testing.assert_array_equal(K[0, 1::2], 0.0)


def test_gradient_with_respect_to_damping(thesis_model):
    at = np.array([0.9, 0.3])

    def size(damping):
        return placed_gain(
            thesis_model, damped_poles(np.array([40.0, 95.0]), damping, DT)
        ) @ np.array([1.0, 100.0, 1.0, 100.0])

    slope = jax.jacobian(size)(at)[0]
    for i in range(2):
        step = 1e-6 * np.eye(2)[i]
        np.testing.assert_allclose(
            slope[i], (size(at + step) - size(at - step))[0] / 2e-6, rtol=1e-6
        )


@pytest.mark.parametrize(
    ("poles", "words"),
    [
        ([0.5, 0.6, 0.7], "poles: the axis has 4 states"),
        ([0.5, 0.6, 0.7, 1.01], "poles: need to be inside the unit circle"),
        ([0.5, 0.6, 0.7, 0.5 + 0.1j], "poles: complex ones need to come in pairs"),
    ],
)
def test_bad_poles_are_named(thesis_model, poles, words):
    with pytest.raises(ValueError, match=words):
        placed_gain(thesis_model, poles)


def test_what_cannot_be_placed_is_named(thesis_model):
    with pytest.raises(ValueError, match="one input"):
        placed_gain(LinearPlant(thesis_model.A, np.ones((4, 2)), thesis_model.C, DT), [0.5] * 4)
    deaf = LinearPlant(np.diag([0.5, 0.6]), [[1.0], [0.0]], [[1.0, 1.0]], DT)
    with pytest.raises(ValueError, match="cannot be controlled"):
        placed_gain(deaf, [0.5] * 2)
    for pair, name in (((-1.0, 0.5), "frequency"), ((1.0, 1.5), "damping")):
        with pytest.raises(ValueError, match=name):
            damped_poles(*pair, DT)


COMPANIONS = numbers_of("adaptive/companions")


class DiskArm(Plant):
    """y(k) = 2 y(k-1) - y(k-2) + b (u(k-1) + u(k-2)); b grows by a half at sample 150."""

    scale: float = 1.0
    dt: float = 1.0

    def initial_state(self, position, increment):
        nothing = jnp.zeros_like(position)
        return position, position, nothing, jnp.zeros((), int)

    def step(self, state, control):
        y, before, last, k = state
        b = self.scale * jnp.where(k + 1 >= 150, 0.03, 0.02)
        free = 2 * y - before + b * (control + last)
        return jnp.where(k == 0, 0.0, 1.0) * free, y, control, k + 1

    def output(self, state):
        return state[0]

    def measure(self, state):
        return state[0]


def square_wave(steps):
    wave = np.sign(np.sin(2 * np.pi * np.arange(steps) / 60 + 1e-9))[:, None]
    contour = line([-1.0], [1.0])
    return from_samples(wave, np.ones_like(wave), 1.0, 0, contour, in_motion=False)


def run(controller, scale=1.0):
    start = (np.zeros(1), np.zeros(1), np.zeros(1), np.zeros((), int))
    return simulate(DiskArm(scale), controller, square_wave(300), start)


def test_estimates_are_those_of_the_reference():
    actual = run(SelfTuning(0.02, 0.25, Sensors((0,)), gain=0.01))
    after = np.append(np.asarray(actual.memory.gain)[1:, 0], actual.final_memory.gain)
    worst = np.max(np.abs(after[250:300] / 0.03 - 1))
    np.testing.assert_allclose(
        [after[149], after[299], worst], COMPANIONS["self_tuning_gain"], rtol=1e-8
    )


@pytest.mark.parametrize("scale", [1e-6, 2.5e-5, 1e4])
def test_the_units_of_the_control_change_nothing(scale):
    """b in SI is small: 0.5 um per unit where a unit accelerates by 1 m/s^2, at 1 ms."""
    plain = run(SelfTuning(0.02, 0.25, Sensors((0,)), gain=0.01))
    controller = SelfTuning(0.02, 0.25, Sensors((0,)), gain=0.01 * scale, variance=1e4 * scale**2)
    scaled = run(controller, scale)
    np.testing.assert_allclose(scaled.output, plain.output, rtol=0, atol=1e-9)
    np.testing.assert_allclose(scaled.memory.gain, scale * plain.memory.gain, rtol=1e-9)


def one_step(controller, gain, variance, control=1.0, y=0.0):
    past = np.array([[0.0], [0.0]])
    controls = np.array([[control], [control]])
    known = (np.array([gain]), np.array([variance]))
    memory = Estimate(past, controls, *known, 5)
    return eqx.filter_jit(controller.step)(memory, np.array([1.0]), np.array([y]))


def test_the_control_is_divided_by_no_less_than_a_part_of_the_first_estimate():
    controller = SelfTuning(0.02, 0.25, Sensors((0,)), gain=1e-6, least=0.2)
    memory, control = one_step(controller, -1e-6, 0.0)
    np.testing.assert_allclose(memory.gain, -1e-6, rtol=1e-12)
    np.testing.assert_allclose(control, 0.02 / (2 * 0.2e-6), rtol=1e-12)


def test_the_variance_grows_to_a_multiple_of_the_first():
    controller = SelfTuning(0.02, 0.25, Sensors((0,)), 1e-6, variance=3.0, growth=5.0)
    memory, _ = one_step(controller, 1e-6, 14.9, control=0.0)
    np.testing.assert_allclose(memory.variance, 15.0, rtol=1e-12)
    memory, _ = one_step(controller, 1e-6, 5.0, control=0.0)
    np.testing.assert_allclose(memory.variance, 5.0 / 0.95, rtol=1e-12)


@pytest.mark.parametrize("pair", [(0.9, 0.8), (0.95, 0.5), (0.85 + 0.1j, 0.85 - 0.1j)])
def test_poles_are_placed(pair):
    """On the loop itself: the response dies as the slowest pole says."""
    kp, kr = placed_gains(*pair)
    poles = np.roots([1.0, (kp + kr) / 2 - 2, 1 + kp / 2, -kr / 2])
    for pole in pair:
        assert np.min(np.abs(poles - pole)) < 1e-9
    # y(k+1) = 2 y - y1 + (w + w1)/2 with w = -kp y - kr (y - y1): states y, y1, w1
    A = np.array([[2 - (kp + kr) / 2, -1 + kr / 2, 0.5], [1.0, 0.0, 0.0], [-(kp + kr), kr, 0.0]])
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(A)), np.sort_complex(poles))


@pytest.mark.parametrize("pair", [(0.9, 0.9), (0.9 + 0.1j, 0.9), (0.9 + 0.1j, 0.8 - 0.1j)])
def test_poles_that_cannot_be_placed(pair):
    with pytest.raises(ValueError, match="poles: need"):
        placed_gains(*pair)


@pytest.mark.parametrize(
    ("pair", "says"),
    [
        ((-1.0, 0.5), "poles: need to be away from 1 and -1"),
        ((0.5, 1.0), "poles: need to be away from 1 and -1"),
        ((np.nan, 0.5), "poles: need to be finite"),
        ((0.5, np.inf), "poles: need to be finite"),
        ((0.1, 0.2), "leave a third pole at 2.03"),
    ],
)
def test_poles_without_stable_gains_are_refused(pair, says):
    with pytest.raises(ValueError, match=says):
        placed_gains(*pair)


def test_the_loop_that_margins_are_of_has_the_poles_and_does_not_learn():
    arm = Encoders(LinearPlant([[1.0, DT], [0.0, 1.0]], [[DT**2 / 2], [DT]], [[1.0, 0.0]], DT))
    law = SelfTuning(*placed_gains(0.9, 0.8), Sensors([0]), gain=DT**2 / 2)
    memory = Estimate(np.zeros((2, 1)), np.zeros((2, 1)), np.full(1, DT**2 / 2), np.ones(1), 0)
    start = arm.initial_state(jnp.zeros(1), jnp.zeros(1))
    memory = jax.tree.map(jnp.asarray, memory)
    loop = frozen_loop(arm, law, jnp.zeros(1), start, memory).cut().closed()
    poles = np.linalg.eigvals(np.asarray(loop))
    for wanted in (0.9, 0.8):
        assert np.abs(poles - wanted).min() < 1e-6
    assert np.abs(poles).max() < 0.9 + 1e-6


def test_bad_input():
    with pytest.raises(ValueError, match="forgetting: needs to be above zero and at most one"):
        SelfTuning(0.02, 0.25, Sensors((0,)), 0.01, forgetting=1.5)
    with pytest.raises(ValueError, match="gain: needs to be finite and above zero"):
        SelfTuning(0.02, 0.25, Sensors((0,)), 0.0)
    with pytest.raises(ValueError, match="least: needs to be finite and above zero"):
        SelfTuning(0.02, 0.25, Sensors((0,)), 0.01, least=0.0)
    with pytest.raises(ValueError, match="growth: needs to be at least one"):
        SelfTuning(0.02, 0.25, Sensors((0,)), 0.01, growth=0.5)
