import jax.numpy as jnp
import numpy as np
import pytest

from tuning.descents.stabilise import Measured, loop_radii, smooth_maximum, stabilised

START = {"x": jnp.asarray(50.0), "y": jnp.asarray(20.0)}
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
    value, slope = smooth_maximum(np.array([700.0, -5.0]), slopes)
    assert value == pytest.approx(700.0 - np.log(2) / 16)
    np.testing.assert_allclose(slope, [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(smooth_maximum(np.zeros(2), slopes)[1], [0.5, 1.0])
    value, slope = smooth_maximum(np.array([np.inf, 0.0]), slopes)
    assert value == np.inf and np.all(slope == np.inf)


@pytest.mark.parametrize("bad", [np.inf, np.nan])
def test_a_measure_that_is_not_finite_gives_up(bad):
    seen = []

    def measure(z):
        seen.append(z)
        return Measured(np.array([bad]), np.zeros((1, 2)), False)

    assert not stabilised(Z, measure).sound and len(seen) == 1


def test_a_step_into_nowhere_is_cut_back():
    def measure(z):
        inside = bool(np.all(np.abs(z) < 4.1))
        value = float(z @ z) if inside else np.inf
        return Measured(np.array([value - 1]), 2 * z[None], value < 1)

    end = stabilised(np.array([4.0, -3.0]), measure)
    assert end.sound and end.z @ end.z < 1


def test_a_slope_that_ends_ends_the_search():
    seen = []

    def measure(z):
        seen.append(z)
        return Measured(np.array([2.0]), np.zeros((1, 2)), False)

    end = stabilised(Z, measure)
    assert not end.sound and len(seen) < 20
    np.testing.assert_array_equal(end.z, Z)


def test_loops_are_needed(proportional_problem):
    with pytest.raises(ValueError, match="does not look at its frozen loops"):
        stabilised(Z, of_loops(proportional_problem(), lambda z: True))
