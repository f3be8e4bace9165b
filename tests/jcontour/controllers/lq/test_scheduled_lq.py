import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights, RiccatiTerminal, balanced
from jcontour.controllers.lq.scheduled_lq import ScheduledLQ
from jcontour.geometry.contours import circle
from jcontour.linear.model_schedule import ModelSchedule
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.motor_coordinates import MotorEncoders, motor_model, motor_schedule
from jcontour.plants.gantry.parameters import thesis_gantry
from jcontour.plants.wrappers.encoders import Sensed
from jcontour.simulation.closed_loop import simulate

DT, PREVIEW, T = 2e-3, 6, 9
POINTS = [-0.3, 0.0, 0.4]
WEIGHTS = LQWeights(2e5, 3e6, balanced(1.0, 3, 1, 2, 0.5), [1.0, 2.0, 0.5, 1.0, 3.0, 1.5])


@pytest.fixture(scope="module")
def schedule():
    return motor_schedule(thesis_gantry(), POINTS, DT)


@pytest.fixture(scope="module")
def reference():
    return along(
        circle(0.25), 0.08 * np.arange(T), DT, PREVIEW, at_rest=False
    )  # fast, to meet many models


def test_a_machine_that_does_not_change_needs_no_schedule(reference):
    model = motor_model(thesis_gantry(), 0.2, DT)
    same = jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), model)
    wanted = ContouringLQ(model, WEIGHTS, PREVIEW, RiccatiTerminal()).prepare(reference)
    found = ScheduledLQ(ModelSchedule(same, POINTS, 0), WEIGHTS, PREVIEW).prepare(reference)
    np.testing.assert_allclose(found.F, wanted.F, rtol=1e-8, atol=1e-8 * np.abs(wanted.F).max())
    np.testing.assert_allclose(found.f, wanted.f, rtol=0, atol=1e-8 * np.abs(wanted.f).max())


@pytest.mark.parametrize("k", [0, T - 1])
def test_control_is_the_minimiser_of_the_stated_cost(schedule, reference, k):
    """The first of N_p controls that minimise the cost written out over the models of the desired positions."""
    models, r = schedule.along(reference.position), np.asarray(reference.tangent)
    y_d, stage, x = (
        np.asarray(reference.position),
        np.asarray(WEIGHTS.stage),
        np.random.default_rng(k).normal(0, 0.01, 6),
    )
    R, end = np.asarray(WEIGHTS.rho), k + PREVIEW
    H = np.stack(
        [
            solve_discrete_are(
                *(
                    np.asarray(m)
                    for m in (one.A, one.B, float(WEIGHTS.alpha + WEIGHTS.beta) * one.C.T @ one.C)
                ),
                R,
            )
            for one in map(schedule.model, range(3))
        ]
    )
    H_end = np.array(
        [[np.interp(y_d[end, 0], POINTS, H[:, i, j]) for j in range(6)] for i in range(6)]
    )
    speed = (y_d[end] - y_d[end - 1]) / DT
    x_d = np.array([y_d[end, 0], y_d[end, 1], y_d[end, 1], speed[0], speed[1], speed[1]])

    def cost(controls):
        state, total = jnp.asarray(x), 0.0
        for j in range(1, PREVIEW + 1):
            u = controls[j - 1]
            state = models.A[k + j - 1] @ state + models.B[k + j - 1] @ u
            total += u @ R @ u
            if j < PREVIEW:
                e = models.C[k + j] @ state - y_d[k + j]
                across = e - r[k + j] * (r[k + j] @ e)
                total += stage[j - 1] * (WEIGHTS.alpha * e @ e + WEIGHTS.beta * across @ across)
        return total + stage[-1] * (state - x_d) @ H_end @ (state - x_d)

    zero = jnp.zeros((PREVIEW, 3))
    slope, curve = (
        jax.grad(cost)(zero).ravel(),
        jax.hessian(cost)(zero).reshape(3 * PREVIEW, 3 * PREVIEW),
    )
    wanted = -np.linalg.solve(curve, slope)[:3]
    controller = ScheduledLQ(schedule, WEIGHTS, PREVIEW)
    plan = controller.prepare(reference)
    _, found = controller.step(None, jax.tree.map(lambda rows: rows[k], plan), jnp.asarray(x))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())


def test_it_keeps_the_tool_on_the_contour_of_the_nonlinear_gantry():
    """Fed the motors, which is all there is to feed."""
    parameters = thesis_gantry()
    schedule = motor_schedule(parameters, [-0.4, 0.0, 0.4], DT)
    reference = along(circle(0.2), 2e-4 * np.arange(500), DT, 20, at_rest=False)
    plant = Sensed(Gantry(parameters, DT), MotorEncoders(parameters))
    run = simulate(
        plant,
        ScheduledLQ(schedule, LQWeights(1e7, 1e8, balanced(1.0, 3, 1, 2, 1.0)), 20),
        reference,
    )
    late = np.asarray(run.output)[100:]
    assert np.abs(np.linalg.norm(late, axis=1) - 0.2).max() < 1e-4


def test_bad_controllers_are_named(schedule, reference):
    with pytest.raises(ValueError, match="preview: needs a whole number"):
        ScheduledLQ(schedule, WEIGHTS, 0)
    with pytest.raises(
        ValueError,
        match=r"stage: needs one entry per preview sample, shape \(3,\), received \(6,\)",
    ):
        ScheduledLQ(schedule, WEIGHTS, 3)
    with pytest.raises(ValueError, match="rho: needs one number or shape"):
        ScheduledLQ(schedule, LQWeights(1.0, 1.0, np.eye(2)), PREVIEW)
    with pytest.raises(ValueError, match="looks 6 samples ahead, the reference was made with 5"):
        ScheduledLQ(schedule, WEIGHTS, PREVIEW).prepare(
            along(circle(0.2), 1e-4 * np.arange(5), DT, 5, at_rest=False)
        )
    with pytest.raises(ValueError, match=r"points: the models cover -0.3 to 0.4 m of output 0"):
        ScheduledLQ(schedule, WEIGHTS, PREVIEW).prepare(
            along(circle(0.45), 1e-4 * np.arange(5), DT, PREVIEW, at_rest=False)
        )
    free = eqx.filter_vmap(lambda A: LinearPlant(A, [[0.0], [1.0]], np.eye(2), 1.0))(
        np.stack([np.diag([1.1, 0.5])] * 2)
    )
    with pytest.raises(ValueError, match="no stabilising solution"):
        ScheduledLQ(ModelSchedule(free, [0.0, 1.0], 0), LQWeights(1.0, 1.0, 1.0), 3)
