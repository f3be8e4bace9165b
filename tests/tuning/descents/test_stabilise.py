import numpy as np
import pytest

from tuning.descents.stabilise import Measured, loop_radii, stabilised

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
