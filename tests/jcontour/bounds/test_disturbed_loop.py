"""Matrices of the disturbed loop: against runs of `simulate` under disturbances."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.bounds.affine import NotAffine
from jcontour.bounds.disturbed_loop import Box, UnstableLoop, check_planless, disturbed_loop
from jcontour.bounds.peak_bounds import peak_bounds
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import FilterObserver, kalman_gain
from jcontour.geometry.contours import polygon
from jcontour.motion.references import along
from jcontour.mpc.tracking.constrained_lq import ConstrainedLQ
from jcontour.mpc.tracking.limits import Limits
from jcontour.plants.actuation import Delayed, Disturbed, PartlyDelayed
from jcontour.plants.encoders import Encoders, Quantised
from jcontour.simulation.closed_loop import simulate
from tests.small_loops import OnPositions

slow = pytest.mark.slow
STEPS = 60
MOVING = 40  # samples before an integral is held
CORNER = polygon([[0.0, 0.0], [1e-3, 0.0], [1e-3, 1e-3]])


class OnPosition(OnPositions):
    """u = -gain (e + 0.1 m), e any function of the error; m(k+1) = e + N m, N not symmetric."""

    gain: float = 150.0
    law: str = "linear"

    def initial_memory(self, reference):
        return jnp.zeros(reference.position.shape[1])

    def step(self, memory, plan, measurement):
        error = measurement - plan
        if self.law == "cubic":
            error = error**3
        other = jnp.array([0.3, -0.2]) * memory[::-1]  # one axis's memory goes into the other's
        return error + other, -self.gain * (error + 0.1 * memory)


def run_on(two_axes):
    return along(CORNER, 2e-5 * np.arange(STEPS), two_axes.dt, 5, at_rest=False)


PLANTS = {
    "late": lambda model: Encoders(Delayed(model, 1, depth=2, inputs=2)),
    "half a sample late": lambda model: Encoders(PartlyDelayed(model, 0.5, depth=1, inputs=2)),
}


@pytest.mark.parametrize("name", ["late", pytest.param("half a sample late", marks=[slow])])
def test_the_matrices_predict_a_disturbed_run(two_axes, name):
    plant, controller, reference = PLANTS[name](two_axes), OnPosition(), run_on(two_axes)
    loop = disturbed_loop(plant, controller, reference)
    random = np.random.default_rng(3)
    w = random.uniform(-1, 1, (STEPS, 4)) * [0.5, 0.5, 1e-5, 1e-5]
    disturbed = Disturbed(plant, force=placed(w[:, :2]), noise=placed(w[:, 2:]))
    run = simulate(disturbed, controller, reference)
    M, E, C, K, D = (np.asarray(matrix) for matrix in loop[:5])
    z = np.zeros(M.shape[1])
    for k in range(STEPS):
        output = np.asarray(loop.output)[k] + C[k] @ z
        control = np.asarray(loop.control)[k] + K[k] @ z + D[k] @ w[k, 2:]
        assert np.asarray(run.output)[k] == pytest.approx(output, rel=1e-9, abs=1e-15)
        assert np.asarray(run.control)[k] == pytest.approx(control, rel=1e-9, abs=1e-12)
        z = M[k] @ z + E[k] @ w[k]
    assert np.abs(np.subtract(run.output, loop.output)).max() > 1e-6


def test_a_controller_that_is_not_linear_is_told(two_axes):
    with pytest.raises(NotAffine, match="OnPosition: its step is not linea"):
        disturbed_loop(Encoders(two_axes), OnPosition(law="cubic"), run_on(two_axes))


def test_limits_that_are_planned_for_are_told(two_axes):
    limited = ConstrainedLQ(two_axes, LQWeights(3.0, 5.0, 2e-9), 2, Limits.within(control=1e9))
    filtered = FilterObserver(limited, two_axes, gain=kalman_gain(two_axes, 0.1, 1e-6))
    for controller, name in ((limited, "ConstrainedLQ"), (filtered, "FilterObserver")):
        with pytest.raises(NotAffine, match=f"{name}: it plans for limits"):
            check_planless(controller)
        check_planless(controller.without_planned_limits())


def test_counting_encoders_are_told(two_axes):
    with pytest.raises(NotAffine, match="Quantised: .* not linear: round"):
        disturbed_loop(Quantised(Encoders(two_axes), 1e-6), OnPosition(), run_on(two_axes))


def test_an_unstable_loop_is_told_with_its_radius_and_place(two_axes):
    with pytest.raises(UnstableLoop, match=r"no finite bound: spectral radius 1\.\d+ at sample \d"):
        disturbed_loop(Encoders(two_axes), OnPosition(gain=-50.0), run_on(two_axes))


class Holding(OnPosition):
    """The law with an integral of the error instead, held after `MOVING` samples."""

    def prepare(self, reference):
        moving = jnp.arange(reference.steps) < MOVING
        return reference.position[: reference.steps], moving

    def step(self, memory, plan, measurement):
        error = measurement - plan[0]
        memory = jnp.where(plan[1], memory + error, memory)
        return memory, -self.gain * (error + 0.1 * memory)


def test_a_held_integral_is_a_bounded_constant(two_axes):
    """Of the largest error at the end, by the sum of the answers to all pulses."""
    reference = run_on(two_axes)
    loop = disturbed_loop(Encoders(two_axes), Holding(), reference)
    M, E, C = (np.asarray(matrix) for matrix in (loop.M, loop.E, loop.C))
    assert np.abs(np.linalg.eigvals(M[-1])).max() == pytest.approx(1.0, abs=1e-9)
    assert loop.radius().max() < 1
    size, wanted, row = np.array([0.5, 0.5, 1e-5, 1e-5]), np.zeros(2), C[-1]
    for k in range(STEPS - 2, -1, -1):
        wanted, row = wanted + np.abs(row @ E[k]) @ size, row @ M[k]
    bound = peak_bounds(loop, C, size).bound[-1]
    np.testing.assert_allclose(bound, wanted, rtol=1e-9)


@slow
def test_a_state_that_is_fed_back_needs_no_memory(two_axes):
    controller = ContouringLQ(two_axes, LQWeights(1e8, 1e8, 1.0), preview=5)
    loop = disturbed_loop(two_axes, controller, run_on(two_axes))
    F = np.asarray(controller.prepare(run_on(two_axes)).F)
    closed = np.asarray(two_axes.A) - np.asarray(two_axes.B) @ F
    assert np.asarray(loop.M) == pytest.approx(closed, rel=1e-12, abs=1e-14)
    assert np.asarray(loop.D) == pytest.approx(-F, rel=1e-12)


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf, [1.0, -1.0]])
def test_a_bound_that_is_none_is_told(bad):
    with pytest.raises(ValueError, match="force: a bound needs to be finite and at least zero"):
        Box.of(bad, 0.0, inputs=2, measured=2)


def test_a_box_of_another_size_is_told():
    with pytest.raises(ValueError, match=r"noise: needs one bound or 2, received shape \(3,\)"):
        Box.of(0.1, [1.0, 2.0, 3.0], inputs=2, measured=2)
