"""Newton's equations of one limit, each put in again; limits of a row by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.qp import staged


def case(seed=0, count=12):
    random = np.random.default_rng(seed)
    upper, lower = random.uniform(0.5, 2.0, count), -random.uniform(0.5, 2.0, count)
    upper[3], lower[5] = np.inf, -np.inf
    penalty = np.where(np.arange(count) % 2 == 0, 4.0, np.inf)
    rows, moved = (random.standard_normal(count) for _ in range(2))
    return *jax.device_get(start(upper, lower, penalty, rows)), rows, moved


@jax.jit
def start(upper, lower, penalty, rows):
    limits = staged.sides(upper, lower, penalty)[0]
    return limits, staged.first_point((), limits.bound - rows, jnp.asarray(0.3), limits, 0.5)


@jax.jit
def whole_step(limits, point, rows, moved, aim):
    """Changes, the point behind them, and by how much it misses its limits."""
    here = staged.newton(point, limits, rows)
    c1, c2 = (product - aim for product in staged.products(point, limits))
    pushed = staged.pushes(here, point, limits, c1, c2)
    steps = staged.changes(here, point, limits, moved + pushed, c1, c2)
    after = staged.moved_on(point, (), steps, 1.0)
    return steps, after, staged.missed_by(after, limits, rows + moved)


@jax.jit
def possible_step(limits, point, rows, moved):
    """The possible part of a step, the point behind it, and one that is beyond it."""
    here = staged.newton(point, limits, rows)
    aims = staged.products(point, limits)
    steps = staged.changes(here, point, limits, moved, *aims)
    far = staged.possible(point, steps, limits)
    return far, *(staged.moved_on(point, (), steps, much * far) for much in (1.0, 1.01))


@pytest.mark.parametrize("aim", [0.0, 0.2])
def test_a_step_puts_the_four_equations_right(aim):
    limits, point, rows, moved = case()
    steps, after, left = jax.device_get(whole_step(limits, point, rows, moved, aim))
    there, gives = limits.there, limits.gives
    assert there.sum() == 11 and gives.sum() == 6
    np.testing.assert_allclose(left, 0.0, atol=1e-13)
    np.testing.assert_allclose((after.l + after.g)[gives], limits.price[gives], rtol=1e-13)
    linear = point.s * steps.l + point.l * steps.s + point.s * point.l
    np.testing.assert_allclose(linear[there], aim, atol=1e-13)
    linear = point.t * steps.g + point.g * steps.t + point.t * point.g
    np.testing.assert_allclose(linear[gives], aim, atol=1e-13)


def test_the_first_products_are_mu_where_the_price_allows_it():
    limits, point, _, _ = case()
    held = limits.there & ~limits.gives
    np.testing.assert_allclose((point.s * point.l)[held], 0.3, rtol=1e-13)
    np.testing.assert_allclose((point.t * point.g)[limits.gives], 0.3, rtol=1e-13)
    assert float(point.l[3]) == 0.0 and (point.l < limits.price)[limits.gives].all()


def test_the_possible_part_of_a_step_ends_at_the_nearest_zero():
    limits, point, rows, moved = case(1)
    step = possible_step(limits, point, rows, 50.0 * moved)
    far, reached, beyond = jax.device_get(step)
    assert far.min() < 1.0 and far.max() <= 1.0
    for part in reached[1:]:
        assert part.min() >= -1e-12
    nearest = np.min(beyond[1:], axis=0)
    assert (nearest[far < 1.0] < 0).all()


def test_widths():
    upper, lower = np.array([3.0, np.inf, 2.0, 0.0]), np.array([-1.0, -4.0, 2.0, -np.inf])
    above, below = jax.jit(staged.sides)(upper, lower, np.full(4, np.inf))
    np.testing.assert_array_equal(above.width, [2.0, 4.0, 2.0, 1.0])
    np.testing.assert_array_equal(below.there, [True, True, True, False])
    np.testing.assert_array_equal(below.bound, [1.0, 4.0, -2.0, 0.0])
