from functools import cache

import control
import jax
import numpy as np
import pytest

from jcontour.controllers.feedback.pole_placement import damped_poles, placed_gain
from jcontour.linear.plant import LinearPlant
from jcontour.plants.flexible_axis.axis import zoh_model

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
