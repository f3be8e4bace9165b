import jax.numpy as jnp
import numpy as np
import pytest

from tuning.stabilise import stabilised

START = {"x": jnp.asarray(50.0), "y": jnp.asarray(20.0)}
Z = np.log([50.0, 20.0])


def test_it_ends_at_the_first_point_that_is_accepted(proportional_problem, loop_peaks):
    problem, seen = proportional_problem(loops=loop_peaks), []

    def accept(z):
        seen.append(z)
        return True

    end = stabilised(problem, START, Z, accept)
    assert end.accepted and len(seen) == 1
    np.testing.assert_array_equal(end.z, seen[0])
    gains = np.exp(end.z) * np.array([[1.0, 0.7], [0.9, 0.8]])
    assert end.radius == pytest.approx(np.abs(1 - gains).max(), rel=1e-9) and end.radius < 1


def test_what_is_never_accepted_ends_with_the_smallest_radius(proportional_problem, loop_peaks):
    end = stabilised(proportional_problem(loops=loop_peaks), START, Z, lambda z: False)
    assert not end.accepted and end.radius < 1


def test_a_radius_that_is_not_finite_gives_up(proportional_problem, loop_peaks):
    far = np.array([800.0, 800.0])
    end = stabilised(proportional_problem(loops=loop_peaks), START, far, lambda z: True)
    assert not end.accepted and end.radius == np.inf


def test_loops_are_needed(proportional_problem):
    with pytest.raises(ValueError, match="does not look at its frozen loops"):
        stabilised(proportional_problem(), START, Z, lambda z: True)
