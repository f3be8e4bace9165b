import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.frozen_loops import dominant, frozen_loop, linear_law, real_outer, unlimited
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains, CascadePlan
from jcontour.controllers.feedback.sliding_mode import AdaptiveRobust, RobustPlan
from jcontour.controllers.lq.contouring_lq import LQWeights
from jcontour.mpc.tracking.constrained_lq import ConstrainedLQ
from jcontour.mpc.tracking.limits import Limits
from jcontour.plants.actuation import Delayed, Saturated
from jcontour.plants.encoders import Encoders
from jcontour.sensors import motors
from tests.jcontour.analysis.given_loops import Law, plant_of


def matrices(*shapes):
    random = np.random.default_rng(0)
    return [random.standard_normal(shape) for shape in shapes]


@pytest.mark.slow
def test_a_linear_loop_is_its_own_linearisation():
    A, B, C = matrices((4, 4), (4, 2), (2, 4))
    W, E, K, D = law = matrices((3, 3), (3, 2), (2, 3), (2, 2))
    plant = Encoders(plant_of(A, B, C))
    state, memory = (jnp.ones(size) for size in (4, 3))
    loop = frozen_loop(plant, Law(*law), None, state, memory)
    for actual, wanted in zip((*loop.machine, *loop.law), (A, B, C, *law), strict=True):
        np.testing.assert_allclose(actual, wanted)
    closed = np.block([[A + B @ D @ C, B @ K], [E @ C, W]])
    np.testing.assert_allclose(loop.cut().closed(), closed, rtol=1e-12)
    # one sample late: (x, w, u(k-1)) by hand
    late = np.block(
        [
            [A, np.zeros((4, 3)), B],
            [E @ C, W, np.zeros((3, 2))],
            [D @ C, K, np.zeros((2, 2))],
        ]
    )
    np.testing.assert_allclose(loop.cut().late(1), late, rtol=1e-12)


@pytest.mark.slow
def test_counters_do_not_move():
    """The tap of a delay line is a whole number; the places of the line are states."""
    A, B, C, D = matrices((4, 4), (4, 2), (2, 4), (2, 2))
    plant = Delayed(Encoders(plant_of(A, B, C)), jnp.asarray(1), 2, 2)
    state = plant.initial_state(jnp.zeros(2), jnp.zeros(2))
    loop = frozen_loop(plant, Law.static(D), None, state, jnp.zeros(0))
    assert loop.machine.A.shape == (8, 8) and loop.law.W.shape == (0, 0)
    np.testing.assert_allclose(loop.machine.A[:4, 4:6], B)
    np.testing.assert_array_equal(loop.machine.B[:4], 0.0)


def test_limits_are_lifted_and_nothing_else():
    A, B, C = matrices((4, 4), (4, 2), (2, 4))
    plant = unlimited(Saturated(plant_of(A, B, C), np.ones(2)))
    assert np.isinf(plant.limit).all() and np.array_equal(plant.plant.A, A)
    cascade = unlimited(Cascade(CascadeGains(1.0, 2.0, 3.0), motors(2), 1e-3, limit=5.0))
    assert np.isinf(cascade.limit) and float(cascade.gains.integral_time) == 3.0


def test_limits_that_are_planned_for_are_lifted():
    model = plant_of(*matrices((4, 4), (4, 2), (2, 4)))
    limits = Limits.within(control=1.0, speed=2.0)
    planning = ConstrainedLQ(model, LQWeights(3.0, 5.0, 2e-9), 3, limits)
    assert len(planning.rows.D) == 4
    assert len(unlimited(planning).rows.D) == 0


def radius_and_slope(M):
    actual = dominant(np.asarray(M, float))
    return float(actual.radius), real_outer(actual.left, actual.right)


@pytest.mark.parametrize("size", [1, 2, 7, 24])
def test_the_radius_and_its_slope(size):
    """By NumPy and central differences."""
    random = np.random.default_rng(size)
    M = random.standard_normal((size, size)) * 10.0 ** random.uniform(-3, 3, (size, 1))

    def by_numpy(M):
        return np.abs(np.linalg.eigvals(M)).max()

    radius, slope = radius_and_slope(M)
    assert radius == pytest.approx(by_numpy(M), rel=1e-12)
    step = 1e-6 * random.standard_normal((size, size)) * np.abs(M)
    wanted = (by_numpy(M + step) - by_numpy(M - step)) / 2
    assert np.sum(slope * step) == pytest.approx(wanted, rel=1e-6)


def test_a_double_eigenvalue_has_the_slope_of_one_of_them():
    _, slope = radius_and_slope(np.diag([0.9, 0.9, 0.1]))
    assert np.trace(slope) == pytest.approx(1.0) and abs(slope[2, 2]) < 1e-9


@pytest.mark.parametrize("M", [np.zeros((2, 2)), [[0.0, 1.0], [0.0, 0.0]]])
def test_a_nilpotent_matrix_has_no_radius_and_a_finite_slope(M):
    radius, slope = radius_and_slope(M)
    assert radius < 1e-7 and np.isfinite(slope).all()


def test_what_is_learned_is_no_part_of_a_loop():
    """Else the estimates of what the motion does not excite were modes that never decay."""
    gains = CascadeGains(30.0, 5.0, 0.05, inertia=0.1, viscous=0.2)
    law = AdaptiveRobust(Cascade(gains, motors(1), 1e-3), adaptation=5.0, share=0.3, load=1.0)
    command = CascadePlan(jnp.ones(1), 0.1 * jnp.ones(1), jnp.zeros(1))
    plan = RobustPlan(command, jnp.array([[1.0, 0.1, 1.0, 1.0]]))
    memory = jnp.array([[0.1, 0.2, 0.0, 0.0]])
    frozen, _ = linear_law(law, plan, memory, (jnp.ones(1), 0.1 * jnp.ones(1)))
    assert not np.any(frozen.W) and not np.any(frozen.E)
    k_1, k_2, k_a = 30.0, 5.0, 0.1
    np.testing.assert_allclose(frozen.D, [[-k_1 * k_2, -k_2 - k_1 * k_a]], rtol=1e-12)
