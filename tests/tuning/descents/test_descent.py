"""Problems of the literature with known optima: W. Hock & K. Schittkowski (1981), and others."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tuning.descents.descent import begin, descend
from tuning.descents.quadratic_step import Model

WIDE = 25.0


class Ended(NamedTuple):
    descent: object
    count: int


@partial(jax.jit, static_argnums=(0, 1))
def numbers(errors, limits, scale, z):
    """Rows of errors and scaled limits, and their slopes."""

    def parts(z):
        return jnp.atleast_2d(errors(z)), scale * jnp.atleast_1d(limits(z))

    return parts(z), jax.jacfwd(parts)(z)


def ended(
    errors, limits, first, scale=1.0, box=WIDE, tolerance=1e-7, steps=100, sound=lambda z: True
):
    """Descent on rows of errors (g, v) under limits (c,), and evaluations."""
    count = 0

    def evaluate(z):
        nonlocal count
        count += 1
        if not sound(z):
            return None
        (e, c), (E, C) = jax.device_get(numbers(errors, limits, scale, z))
        return Model(e, c, E, C)

    first = np.asarray(first, float)
    descent = begin(first, evaluate(first))
    while not descent.done and descent.steps < steps:
        descent = descend(descent, evaluate, (first - box, first + box), tolerance)
    return Ended(descent, count)


def free(z):
    return jnp.zeros(0)


def cb2(z):
    """C. Charalambous & A. R. Conn (1978), problem 2: 1.9522245 at (1.1390, 0.8996)."""
    x, y = z
    return jnp.log(jnp.array([x**2 + y**4, (2 - x) ** 2 + (2 - y) ** 2, 2 * jnp.exp(y - x)]))


@pytest.mark.parametrize("first", [(1.0, -0.1), (3.0, 2.0), (-4.0, 3.5), (0.0, -5.0)])
def test_a_minimax(first):
    descent, count = ended(cb2, free, first)
    assert descent.stationary and count <= 60
    assert descent.model.objective == pytest.approx(np.log(1.9522245), abs=1e-6)
    np.testing.assert_allclose(descent.z, [1.1390, 0.8996], atol=2e-3)
    assert descent.shares.sum() == pytest.approx(1.0, rel=5e-3)


def rosen_suzuki(z):
    a, b, c, d = z
    return a**2 + b**2 + 2 * c**2 + d**2 - 5 * a - 5 * b - 21 * c + 7 * d


def rosen_suzuki_limits(z):
    a, b, c, d = z
    return jnp.array(
        [
            a**2 + b**2 + c**2 + d**2 + a - b + c - d - 8,
            a**2 + 2 * b**2 + c**2 + 2 * d**2 - a - d - 10,
            2 * a**2 + b**2 + c**2 + 2 * a - b - d - 5,
        ]
    )


@pytest.mark.parametrize("first", [(0.0, 0.0, 0.0, 0.0), (5.0, -5.0, 5.0, 5.0)])
@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e3])
def test_limits_and_their_prices_whatever_their_scale(first, scale):
    """Hock & Schittkowski 43: -44 at (0, 1, 2, -1) with the multipliers 1, 0 and 2."""
    descent, count = ended(rosen_suzuki, rosen_suzuki_limits, first, scale)
    assert descent.stationary and count <= 60
    assert descent.model.objective == pytest.approx(-44.0, abs=1e-4)
    np.testing.assert_allclose(descent.z, [0, 1, 2, -1], atol=1e-3)
    np.testing.assert_allclose(scale * descent.prices, [1, 0, 2], atol=2e-2)


def test_rows_count_by_their_mean():
    """A row each: the mean of the maxima |x - 1| and |x + 1| + y^2 is 1 between them."""

    def rows(z):
        x, y = z
        return jnp.stack(
            [jnp.array([x - 1, 1 - x]), jnp.array([x + 1 + y**2, -x - 1 + y**2])], axis=0
        )

    descent, _ = ended(rows, free, (3.0, 2.0))
    assert descent.stationary
    assert descent.model.objective == pytest.approx(1.0, abs=1e-6)
    assert abs(descent.z[1]) < 1e-3 and abs(descent.z[0]) <= 1 + 1e-6


def to_the_right(z):
    return -z[0]


def banana(z):
    x, y = z
    return 1e-3 * jnp.array([jnp.arctan(x**2 - y), jnp.arctan(y - x**2 - 0.1 * (2 - x))])


@pytest.mark.parametrize("first", [(0.0, 0.0), (3.0, -4.0), (-2.0, 8.0), (6.0, 6.0)])
def test_a_narrow_curved_valley(first):
    """A limit that moves by a thousandth decides an objective that moves by ones.

    x^2 - y - 1 <= 0 and its mirror leave a banana; at its end x = 2 the limits cross.
    """
    descent, count = ended(to_the_right, banana, first)
    assert descent.stationary and count <= 100
    np.testing.assert_allclose(descent.z, [2.0, 4.0], atol=1e-4)
    assert descent.model.excess < 1e-6


def ten_times_the_sum(z):
    return 10 * jnp.sum(z)


def chained_valley(z):
    chained = 100 * (z[1:] - z[:-1] ** 2) ** 2 + (1 - z[:-1]) ** 2
    return jnp.log(1e-2 + jnp.sum(chained))


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 1e-3])
@pytest.mark.parametrize("seed", range(3))
def test_limits_beyond_a_curved_valley_are_met(scale, seed):
    """Ten weights: the limit holds near the end of Rosenbrock's chained valley, at ones."""
    first = np.random.default_rng(seed).uniform(-2, 2, 10)
    descent, count = ended(
        ten_times_the_sum, chained_valley, first, scale, tolerance=1e-4, steps=300
    )
    assert descent.model.excess <= 1e-6 * scale and count <= 300


def test_a_flat_limit_is_met_beside_a_steep_one_that_holds():
    """A limit that tells little far away, beside one a million times as steep."""

    def limits(z):
        return jnp.array([1e-3 * jnp.tanh(z[0] - 1) + 5e-4, 1e3 * (z[1] - 10)])

    descent, count = ended(lambda z: -z[0] - z[1], limits, (6.0, 0.0), tolerance=1e-6)
    assert descent.stationary and count <= 60
    np.testing.assert_allclose(descent.z, [1 - np.arctanh(0.5), 10.0], atol=1e-4)


def test_limits_that_nothing_meets_end_where_they_are_nearest():
    descent, count = ended(lambda z: z[0], lambda z: jnp.array([(z[0] - 2) ** 2 + 0.5]), (-3.0,))
    assert descent.done and not descent.stationary and count <= 100
    assert descent.model.excess == pytest.approx(0.5, abs=5e-2)


def test_a_descent_does_not_leave_its_box():
    descent, _ = ended(lambda z: -jnp.sum(z), free, (0.0, 1.0), box=7.0)
    assert descent.stationary
    np.testing.assert_allclose(descent.z, [7.0, 8.0], rtol=1e-12)


def test_a_region_that_diverges_is_not_entered():
    descent, count = ended(to_the_right, free, (0.0,), sound=lambda z: z[0] < 1.0)
    assert not descent.stationary
    assert 0.999 < descent.z[0] < 1.0 and count <= 100


def test_a_flat_objective_is_stationary_at_once():
    descent, count = ended(lambda z: 0.0 * z[0], free, (1.0,))
    assert descent.stationary and count == 1
