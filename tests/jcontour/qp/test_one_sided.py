"""Newton's equations of one limit, each put in again; limits of a row by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.qp import one_sided


def case(seed=0, count=12):
    random = np.random.default_rng(seed)
    upper = jnp.asarray(random.uniform(0.5, 2.0, count)).at[3].set(jnp.inf)
    lower = jnp.asarray(-random.uniform(0.5, 2.0, count)).at[5].set(-jnp.inf)
    penalty = jnp.where(jnp.arange(count) % 2 == 0, 4.0, jnp.inf)
    limits = one_sided.sides(upper, lower, penalty)[0]
    rows, moved = (jnp.asarray(random.standard_normal(count)) for _ in range(2))
    point = one_sided.first_point((), limits.bound - rows, jnp.asarray(0.3), limits, 0.5)
    return limits, point, rows, moved


@pytest.mark.parametrize("aim", [0.0, 0.2])
def test_a_step_puts_the_four_equations_right(aim):
    limits, point, rows, moved = case()
    here = one_sided.newton(point, limits, rows)
    c1, c2 = (product - aim for product in one_sided.products(point, limits))
    pushed = one_sided.pushes(here, point, limits, c1, c2)
    steps = one_sided.changes(here, point, limits, moved + pushed, c1, c2)
    there, gives = np.asarray(limits.there), np.asarray(limits.gives)
    assert there.sum() == 11 and gives.sum() == 6
    after = one_sided.moved_on(point, (), steps, 1.0)
    left = one_sided.missed_by(after, limits, rows + moved)
    np.testing.assert_allclose(left, 0.0, atol=1e-13)
    np.testing.assert_allclose((after.l + after.g)[gives], limits.price[gives], rtol=1e-13)
    linear = point.s * steps.l + point.l * steps.s + point.s * point.l
    np.testing.assert_allclose(linear[there], aim, atol=1e-13)
    linear = point.t * steps.g + point.g * steps.t + point.t * point.g
    np.testing.assert_allclose(linear[gives], aim, atol=1e-13)


def test_the_first_products_are_mu_where_the_price_allows_it():
    limits, point, _, _ = case()
    held = np.asarray(limits.there & ~limits.gives)
    np.testing.assert_allclose((point.s * point.l)[held], 0.3, rtol=1e-13)
    np.testing.assert_allclose((point.t * point.g)[np.asarray(limits.gives)], 0.3, rtol=1e-13)
    assert float(point.l[3]) == 0.0 and (point.l < limits.price)[np.asarray(limits.gives)].all()


def test_the_possible_part_of_a_step_ends_at_the_nearest_zero():
    limits, point, rows, moved = case(1)
    here = one_sided.newton(point, limits, rows)
    aims = one_sided.products(point, limits)
    steps = one_sided.changes(here, point, limits, 50.0 * moved, *aims)
    far = one_sided.possible(point, steps, limits)
    assert float(far.min()) < 1.0 and float(far.max()) <= 1.0
    for part in one_sided.moved_on(point, (), steps, far)[1:]:
        assert float(part.min()) >= -1e-12
    beyond = one_sided.moved_on(point, (), steps, 1.01 * far)
    nearest = np.min([np.asarray(part) for part in beyond[1:]], axis=0)
    assert (nearest[np.asarray(far) < 1.0] < 0).all()


def test_widths():
    upper, lower = jnp.array([3.0, jnp.inf, 2.0, 0.0]), jnp.array([-1.0, -4.0, 2.0, -jnp.inf])
    above, below = one_sided.sides(upper, lower, jnp.full(4, jnp.inf))
    np.testing.assert_array_equal(above.width, [2.0, 4.0, 2.0, 1.0])
    np.testing.assert_array_equal(below.there, [True, True, True, False])
    np.testing.assert_array_equal(below.bound, [1.0, 4.0, -2.0, 0.0])
