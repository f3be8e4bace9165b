"""Ends just outside a curved limit: smallest y - 2x over y >= x^2 is -1 at (1, 1)."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tuning.descents.descent import begin, descend
from tuning.descents.quadratic_step import Model
from tuning.descents.stabilise import TRIES, Measured, landed, loop_radii, outside, stabilised

START = {"x": np.asarray(50.0), "y": np.asarray(20.0)}
Z = np.log([50.0, 20.0])


def of_loops(problem, sound):
    def measure(z):
        radii, slopes = loop_radii(problem, START, z)
        return Measured(radii, slopes, bool(radii.max() < 0) and sound(z))

    return measure


def radius(z):
    return np.abs(1 - np.exp(z) * np.array([[1.0, 0.7], [0.9, 0.8]])).max()


def test_it_ends_at_the_first_sound_point(proportional_problem, loop_peaks):
    seen = []

    def sound(z):
        seen.append(z)
        return len(seen) == 3

    end = stabilised(Z, of_loops(proportional_problem(loops=loop_peaks), sound))
    assert end.sound and len(seen) == 3
    np.testing.assert_array_equal(end.z, seen[2])
    assert end.largest == pytest.approx(np.log(radius(end.z)), rel=1e-9) and end.largest < 0


def test_what_is_never_sound_ends_near_the_smallest_radius(proportional_problem, loop_peaks):
    """The least of max |1 - b k| over b from 0.7 to 0.8 is 1/15."""
    end = stabilised(Z, of_loops(proportional_problem(loops=loop_peaks), lambda z: False))
    assert not end.sound
    assert end.largest == pytest.approx(np.log(radius(end.z)), rel=1e-9)
    assert 1 / 15 <= np.exp(end.largest) < 0.2


def test_slopes_of_the_radii_are_those_of_differences(proportional_problem, loop_peaks):
    problem, h = proportional_problem(loops=loop_peaks), 1e-6
    at = lambda z: loop_radii(problem, START, z)  # noqa: E731
    radii, slopes = at(Z)
    assert radii.max() == pytest.approx(np.log(radius(Z)), rel=1e-12)
    steps = [(at(Z + h * e)[0] - at(Z - h * e)[0]) / (2 * h) for e in np.eye(2)]
    np.testing.assert_allclose(slopes, np.stack(steps, axis=1), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("size", [1.0, 1e-2, 1e-4])
def test_loops_that_hardly_differ_are_led_like_those_that_do(size):
    """The mean of these three falls where the largest rises: the largest counts."""
    slopes = size * np.array([[1.0, 0.2], [-3.0, 0.1], [-3.0, 0.1]])
    level = size * np.array([0.3, -0.7, -0.7])

    def measure(z):
        numbers = level + slopes @ z
        return Measured(numbers, slopes, bool(numbers.max() < 0))

    end = stabilised(np.zeros(2), measure)
    assert end.sound and end.largest < 0


def test_a_problem_that_does_not_look_at_its_loops_has_no_radius(proportional_problem):
    with pytest.raises(ValueError, match="does not look at its frozen loops"):
        loop_radii(proportional_problem(), START, Z)


def test_smooth_maximum_and_its_slope():
    slopes = np.array([[1.0, 0.0], [0.0, 2.0]])

    def smooth(numbers, scale=1.0):
        return Measured(np.array(numbers), slopes, False).smooth(scale)

    value, slope = smooth([700.0, -5.0])
    assert value == pytest.approx(700.0 - np.log(2) / 16)
    np.testing.assert_allclose(slope, [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(smooth([0.0, 0.0]).slope, [0.5, 1.0])
    value, slope = smooth([0.7, -5e-3], scale=1e-3)
    assert value == pytest.approx(700.0 - np.log(2) / 16)
    np.testing.assert_allclose(slope, [1e3, 0.0], atol=1e-12)
    value, slope = smooth([np.inf, 0.0])
    assert value == np.inf and np.all(slope == np.inf)


BOX = np.full(2, -9.0), np.full(2, 9.0)


def parabola(scale):
    """Limit scale sinh(x^2 - y), and how often it was evaluated."""
    return counted(downhill, above_the_parabola, scale)


def downhill(z):
    return z[1] - 2 * z[0]


def above_the_parabola(z):
    return jnp.sinh(z[0] ** 2 - z[1])


def both(z):
    return -z[0] - z[1]


def kinked(z):
    return jnp.max(jnp.array([z[0] - 0.99 * z[1], z[1] - 0.99 * z[0]]) - 0.01)


@partial(jax.jit, static_argnums=(0, 1))
def numbers(objective, limit, scale, z):
    def values(z):
        return objective(z)[None, None], scale * limit(z)[None]

    return values(z), jax.jacfwd(values)(z)


def counted(objective, limit, scale=1.0):
    points = []

    def evaluate(z):
        points.append(z)
        (e, c), (E, C) = jax.device_get(numbers(objective, limit, scale, z))
        return Model(e, c, E, C)

    return evaluate, points


def cut_short(evaluate, first, steps):
    descent = begin(first, evaluate(first))
    while descent.steps < steps:
        descent = descend(descent, evaluate, BOX, 1e-7)
    return descent


@pytest.mark.parametrize("scale", [1.0, 1e2, 1e4])
@pytest.mark.parametrize("violation", [1e-6, 1e-5, 1e-3])
def test_an_end_just_outside_lands_at_the_optimum_whatever_the_scale(scale, violation):
    """The way inside costs what the excess was worth: its price is 1 / scale."""
    evaluate, points = parabola(scale)
    first = np.array([1.0, 1.0 - violation / scale])
    descent = landed(begin(first, evaluate(first)), evaluate, BOX, 1e-2)
    assert descent.done and descent.landed and not outside(descent) and len(points) <= 3
    assert -1 <= descent.model.objective + 1e-6 / scale
    assert descent.model.objective + 1 < 2 * violation / scale
    assert descent.stationary


def test_a_descent_that_was_cut_short_is_worth_its_last_point():
    """After ten iterations it stands 4e-5 outside, and had never been inside but at its start."""
    evaluate, points = parabola(1.0)
    descent = cut_short(evaluate, np.array([-2.0, 5.0]), 10)
    assert 1e-5 < descent.model.excess < 1e-4
    inside = [one for one in map(evaluate, points.copy()) if one.excess <= 1e-6]
    assert min(one.objective for one in inside) > 5.0
    descent = landed(descent, evaluate, BOX, 1e-7)
    assert not outside(descent)
    assert descent.model.objective == pytest.approx(-1.0, abs=5e-5)


@pytest.mark.parametrize("scale", [1e-2, 1.0, 1e3])
def test_a_limit_with_a_kink(scale):
    """The largest of two numbers: each landing sees one slope, and the corner has two."""
    evaluate, _ = counted(both, kinked, scale)
    first = np.array([1.0 + 1e-3, 1.0 + 2e-3])  # the corner is (1, 1)
    descent = landed(begin(first, evaluate(first)), evaluate, BOX, 1e-2)
    assert not outside(descent) and descent.model.objective < -1.5


def test_room_that_was_not_needed_is_given_up():
    """A flat end far outside: the way back recovers most of what the room cost."""
    evaluate, _ = counted(lambda z: -z[0], lambda z: z[0] - 1 + 0 * z[1])
    first = np.array([1.5, 0.0])
    descent = landed(begin(first, evaluate(first)), evaluate, BOX, 1e-3)
    assert 0.97 < descent.z[0] <= 1.0


def test_one_evaluation_is_enough_to_come_inside():
    evaluate, points = parabola(1.0)
    first = np.array([1.0, 1.0 - 1e-4])
    descent = landed(begin(first, evaluate(first)), evaluate, BOX, 1e-7, tries=1)
    assert not outside(descent) and len(points) == 2


@pytest.mark.parametrize("least", [1e-3, 1.0])
def test_limits_that_nothing_meets_are_not_landed_on(least):
    evaluate, points = counted(lambda z: z[0], lambda z: jnp.cosh(z[0]) - 1 + least)
    first = np.array([0.1, 0.0])
    descent = landed(begin(first, evaluate(first)), evaluate, BOX, 1e-3)
    assert descent.done and descent.landed and outside(descent) and not descent.stationary
    np.testing.assert_array_equal(descent.z, first)
    assert len(points) <= 1 + TRIES


def test_a_point_that_diverges_ends_the_landing():
    evaluate, _ = parabola(1.0)
    first = np.array([1.0, 0.9])
    descent = landed(begin(first, evaluate(first)), lambda z: None, BOX, 1e-3)
    assert descent.done and outside(descent)


def test_a_point_inside_that_promises_more_is_not_stationary():
    evaluate, _ = parabola(1.0)
    first = np.array([0.0, -1e-3])
    descent = landed(begin(first, evaluate(first)), evaluate, BOX, 1e-3)
    assert not outside(descent) and not descent.stationary
