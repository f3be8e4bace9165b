"""Nominal runs of a machine, against dense least squares and the machine itself."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.geometry.contours import line
from jcontour.linear.plant import LinearPlant
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.references import in_time
from jcontour.mpc.machine_runs import machine_run
from jcontour.plant import Plant
from jcontour.plants.gantry.gantry import Gantry, thesis_gantry
from jcontour.plants.gantry.linear_models import currents_along

DT = 1e-2


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture(scope="module")
def slide():
    return LinearPlant([[1, DT], [0, 0.98]], [[DT**2 / 2], [DT]], [[1.0, 0.0]], dt=DT)


@pytest.fixture(scope="module")
def ramp():
    return in_time(line([0.0], [0.01]), PointToPoint(0.01, 0.1, 2.0), 0.2, DT, preview=4)


def test_on_a_linear_machine_it_is_the_least_squares_optimum(slide, ramp, rng):
    S = len(ramp.position)
    given = rng.normal(size=(S, 1))
    length, size = 1e-4, 0.5
    actual = machine_run(slide, ramp, given, length, size, rounds=1)
    A, B, C = (np.asarray(matrix) for matrix in (slide.A, slide.B, slide.C))
    maps = np.zeros((S, S))
    for k in range(S):
        for j in range(k):
            maps[k, j] = (C @ np.linalg.matrix_power(A, k - 1 - j) @ B)[0, 0]
    rows = np.concatenate([maps / length, np.eye(S) / size])
    wanted = np.concatenate([np.asarray(ramp.position)[:, 0] / length, given[:, 0] / size])
    optimum = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    np.testing.assert_allclose(actual.control[:, 0], optimum, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(actual.output[:, 0], maps @ optimum, atol=1e-12)
    assert actual.state.shape == (S + 1, 2)
    np.testing.assert_allclose(actual.A[3], A, atol=1e-15)


@pytest.mark.slow
def test_the_gantry_follows_a_line_within_a_nanometre():
    p, dt = thesis_gantry(), 2e-3
    path = line([0.08, -0.02], [0.07, 0.0])
    law = PointToPoint(float(path.length), 0.1, 1.0)
    reference = in_time(path, law, 0.4, dt, preview=8, dwell=0.02)
    gantry = Gantry(p, dt)
    given = currents_along(p, reference.position, dt)
    actual = machine_run(gantry, reference, given, 1e-8, 1.0)
    assert np.abs(actual.output - np.asarray(reference.position)).max() < 5e-9
    assert np.abs(actual.control).max() < 2.0  # [A]
    k = 60
    z, v = jnp.asarray(actual.state[k]), jnp.asarray(actual.control[k])
    np.testing.assert_allclose(gantry.step(z, v), actual.state[k + 1], atol=1e-14)
    small = 1e-6 * np.array([1.0, -2.0, 0.5, 3.0, 1.0, -1.0])
    moved = np.asarray(gantry.step(z + small, v)) - actual.state[k + 1]
    np.testing.assert_allclose(moved, actual.A[k] @ small, atol=1e-10)


class Stiffening(Plant):
    """A slide whose spring stiffens: x'' = u - 200 x^3, by Euler."""

    dt: float = DT

    def initial_state(self, position, increment):
        return jnp.stack([position[0], increment[0] / self.dt])

    def step(self, state, control):
        x, v = state
        return jnp.stack([x + self.dt * v, v + self.dt * (control[0] - 200 * x**3)])

    def output(self, state):
        return state[:1]


def test_a_run_that_has_not_settled_is_refused():
    reference = in_time(line([0.0], [0.3]), PointToPoint(0.3, 1.0, 10.0), 0.3, DT, preview=4)
    given = np.zeros((len(reference.position), 1))
    with pytest.raises(ValueError, match="rounds: after 2 the next would change a control by"):
        machine_run(Stiffening(), reference, given, 1e-3, 1.0, rounds=2)
    actual = machine_run(Stiffening(), reference, given, 1e-3, 1.0, rounds=4)
    more = machine_run(Stiffening(), reference, given, 1e-3, 1.0, rounds=5)
    assert np.abs(more.control - actual.control).max() <= 1e-6


def test_bad_input(slide, ramp):
    S = len(ramp.position)
    with pytest.raises(ValueError, match=f"controls: needs {S} samples, received 3"):
        machine_run(slide, ramp, np.zeros((3, 1)), 1e-4, 1.0)
    with pytest.raises(ValueError, match="length, size, rounds"):
        machine_run(slide, ramp, np.zeros((S, 1)), 0.0, 1.0)
    with pytest.raises(ValueError, match="not finite"):
        machine_run(slide, ramp, np.full((S, 1), np.nan), 1e-4, 1.0)
