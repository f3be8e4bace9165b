"""Bending of the gantry, against the machine itself at corners of tubes."""

import jax
import numpy as np
import pytest

from jcontour.bounds.gantry.gantry_bending import Bending
from jcontour.bounds.gantry.intervals import Interval
from jcontour.bounds.gantry.second_derivatives import Enclosure
from jcontour.plants.gantry.gantry import Gantry, thesis_gantry

STATES = np.array([2e-4, 2e-4, 1e-4, 2e-2, 2e-2, 1e-2])  # [m, rad, m/s, rad/s]
CURRENTS = np.array([2.0, 2.0, 2.0])  # [A]
RUN = np.array([[0.07, 0.02, 1e-4, 0.1, -0.2, 1e-3], [-0.05, 0.0, 0.0, 0.0, 0.3, -1e-2]])
CONTROL = np.array([[1.0, -1.0, 0.5], [0.0, 2.0, 2.0]])


@pytest.fixture(scope="module")
def gantry():
    return Gantry(thesis_gantry(), 2e-3)


@pytest.fixture(scope="module")
def bending(gantry):
    return Bending(gantry, RUN, CONTROL)


def bound(bending, size):
    shape = (len(RUN), 1)
    return bending.remainder(np.tile(size * STATES, shape), np.tile(size * CURRENTS, shape))


def bent(gantry, e, du):
    """Largest difference of the machine from its Jacobians over rows of deviations (T, 6)."""
    moved = jax.vmap(lambda x, u, e, du: gantry.step(x + e, u + du), (None, None, 0, 0))
    slopes = jax.jacfwd(gantry.step, (0, 1))

    @jax.jit
    def difference(x, u):
        A, B = slopes(x, u)
        return moved(x, u, e, du) - (gantry.step(x, u)[None] + e @ A.T + du @ B.T)

    return np.stack(
        [np.abs(difference(*row)).max(axis=0) for row in zip(RUN, CONTROL, strict=True)]
    )


@pytest.mark.slow
def test_no_corner_of_a_tube_bends_more_and_some_come_near(gantry, bending):
    rng = np.random.default_rng(0)
    e = STATES * rng.choice([-1.0, 1.0], size=(512, 6))
    du = CURRENTS * rng.choice([-1.0, 1.0], size=(512, 3))
    most, met = bound(bending, 1.0), bent(gantry, e, du)
    assert (met <= most).all()
    assert ((met / most).max(axis=1) >= 0.2).all()


def test_the_bound_grows_with_the_square_of_the_tube(bending):
    np.testing.assert_allclose(bound(bending, 0.5), 0.25 * bound(bending, 1.0), rtol=0.02)


def test_a_constant_bend_is_the_runge_kutta_step_of_its_equation(bending):
    """From d' = J d + c, at h: h (1 + z/2 + z^2/6 + z^3/24) c, z = J h."""
    h, c, J = bending.h, 3.0, 0.7 / bending.h
    bend, slope = np.zeros((1, 9, 9)), np.zeros((1, 9))
    bend[0, 6, 6], slope[0, 0] = 2 * c, J  # of the square of a current of one
    one = Enclosure(Interval.of(np.zeros(1)), Interval.of(slope), Interval.of(bend))
    still = one._replace(slope=Interval.of(0 * slope), bend=Interval.of(0 * bend))
    left, _ = bending._substep(np.zeros((1, 6)), np.array([[1.0, 0.0, 0.0]]), [one] + [still] * 5)
    wanted = h * c * (1 + 0.7 / 2 + 0.7**2 / 6 + 0.7**3 / 24)
    np.testing.assert_allclose(left[0], [wanted, 0, 0, 0, 0, 0], rtol=1e-12)


def test_the_tool_bends_no_more_than_its_bound(gantry, bending):
    rng = np.random.default_rng(1)
    most = bending.of(gantry.output, np.tile(STATES, (len(RUN), 1)))

    @jax.jit
    def difference(x, e):
        moved, linear = jax.jvp(gantry.output, (x,), (e,))
        return gantry.output(x + e) - moved - linear

    for k, x in enumerate(RUN):
        for e in STATES * rng.choice([-1.0, 1.0], size=(32, 6)):
            assert (np.abs(difference(x, e)) <= most[k]).all()
    theta = STATES[2] * (STATES[0] + 1e-4 * STATES[2])
    assert (most[:, 1] >= theta).all()  # dx sin(theta) alone


def test_a_tube_that_does_not_close_is_told(bending):
    with pytest.raises(ValueError, match="does not close|reaches zero"):
        bound(bending, 1e5)
