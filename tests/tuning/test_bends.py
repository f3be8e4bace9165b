"""Bends, their bounds and their copy, against dense matrices."""

import jax.numpy as jnp
import numpy as np
import pytest

from tuning.bends import FIRST, GROWTH, INSIDE, Bounds, Copy, bend_back, bend_of, eased

STEPS, AXES = 9, 2


def matrix():
    return np.diff(np.pad(np.eye(STEPS), ((1, 1), (0, 0))), 2, axis=0)


def rows(seed=0):
    return np.random.default_rng(seed).normal(size=(STEPS, AXES))


def test_the_second_difference_and_its_transpose():
    np.testing.assert_allclose(bend_of(jnp.asarray(rows())), matrix() @ rows(), atol=1e-14)
    np.testing.assert_allclose(bend_back(jnp.asarray(rows())), matrix().T @ rows(), atol=1e-14)


def test_eased_is_the_inverse_of_a_square():
    size, rough = 1.3, 40.0
    root = np.sqrt(size) * np.eye(STEPS) - np.sqrt(rough) * matrix()
    found = eased(jnp.asarray(rows()), jnp.asarray(size), jnp.asarray(rough))
    np.testing.assert_allclose(found, np.linalg.solve(root @ root, rows()), rtol=1e-10, atol=1e-12)


def test_bounds_hold_the_bend_beside_its_middle():
    middle, reach = rows(1), np.full((STEPS, AXES), 0.5)
    bounds = Bounds(middle, reach)
    for share, kept in ((0.99, True), (1.01, False)):
        correction = np.linalg.solve(matrix(), middle + share * reach)
        assert bounds.keep(correction) is kept
    reach[:] = np.inf
    assert bounds.keep(1e6 * rows()) and not bounds.are_some


def test_what_the_copy_keeps_is_inside_and_has_room_for_no_bend():
    middle, reach = np.array([[0.0], [3.0], [-3.0]]), np.array([[2.0], [2.0], [2.0]])
    least, most = Bounds(middle, reach).inner
    np.testing.assert_allclose(least.ravel(), [-2 * INSIDE, 0.0, -3 - 2 * INSIDE])
    np.testing.assert_allclose(most.ravel(), [2 * INSIDE, 3 + 2 * INSIDE, 0.0])


def test_without_bounds_the_copy_is_the_bend_and_costs_nothing():
    free = Bounds.none(STEPS, AXES)
    least, most = (jnp.asarray(edge) for edge in free.inner)
    copy = Copy.of(free)
    for seed in range(3):
        copy = copy.after(jnp.asarray(rows(seed)), (least, most))
        assert float(copy.penalty) == 0.0
        np.testing.assert_allclose(copy.multiplier, 0.0, atol=1e-14)


def test_a_bend_that_stays_outside_pushes_ever_more():
    """The bend 2 beyond a bound of 1: what pushes it back, penalty times multiplier, grows."""
    bounds = Bounds(np.zeros((1, 1)), np.ones((1, 1)))
    within = tuple(jnp.asarray(edge) for edge in bounds.inner)
    copy, pushes = Copy.of(bounds), []
    assert float(copy.penalty) == FIRST
    for _ in range(5):
        copy = copy.after(jnp.full((1, 1), 2.0), within)
        assert abs(float(copy.place[0, 0])) <= INSIDE
        pushes.append(float(copy.penalty * copy.multiplier[0, 0]))
    assert np.all(np.diff(pushes) > 0) and float(copy.penalty) == pytest.approx(GROWTH**5 * FIRST)
    inside = copy.after(jnp.full((1, 1), 0.98), within)  # between those of the copy and its own
    assert float(inside.penalty) == float(copy.penalty)
