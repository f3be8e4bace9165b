import numpy as np
import pytest
import scipy.signal

from jcontour.controllers.contouring.schemes import (
    ConstantCoupling,
    CrossCoupled,
    CrossGains,
    VariableCoupling,
)
from jcontour.simulation.closed_loop import simulate

ANGLE = 0.6
NORMAL = np.array([-np.sin(ANGLE), np.cos(ANGLE)])
MISMATCHED = (20.0, 30.0)


@pytest.mark.parametrize("coupling", [ConstantCoupling(), VariableCoupling()])
@pytest.mark.parametrize("angle", [ANGLE, 2.5, -0.3, np.pi / 2])
def test_steady_error_on_a_line_with_mismatched_axes(table, coupling, angle):
    """In steady motion (k_pp + C k_p K') e = (1 - k_ff) v: the integrators hold each velocity.

    The contour error shrinks by 1 + k_p sum_i C_i n_i / k_pp,i (Sherman and Morrison); along an
    axis-parallel line C_i = 0 there.
    """
    share, k_p = 0.2, 60.0
    normal = np.array([-np.sin(angle), np.cos(angle)])
    C = (
        np.where(np.abs(normal) > 1e-9, np.sign(normal), 0)
        if isinstance(coupling, ConstantCoupling)
        else normal
    )
    speed = table.feed * np.array([np.cos(angle), np.sin(angle)])
    expected = np.linalg.solve(np.diag(MISMATCHED) + k_p * np.outer(C, normal), (1 - share) * speed)
    reference = table.on_line(angle)
    found = table.last_error(
        table.plant,
        CrossCoupled(table.cascade(MISMATCHED, share), CrossGains(k_p), coupling),
        reference,
    )
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
    plain = table.last_error(table.plant, table.cascade(MISMATCHED, share), reference)
    assert normal @ found == pytest.approx(
        normal @ plain / (1 + k_p * np.sum(C * normal / MISMATCHED)), rel=1e-6, abs=1e-10
    )


def test_integral_leaves_no_contour_error_on_a_line(table):
    controller = CrossCoupled(
        table.cascade(MISMATCHED), CrossGains(20.0, 600.0), VariableCoupling()
    )
    error = table.last_error(table.plant, controller, table.on_line(ANGLE))
    plain = table.last_error(table.plant, table.cascade(MISMATCHED), table.on_line(ANGLE))
    assert abs(NORMAL @ plain) > 1e-4 and abs(NORMAL @ error) < 1e-8


def test_the_whole_run_on_a_line_is_the_linear_loop_of_scipy(table):
    """PID, plant and cascade as one state-space system, from the equations of the module."""
    k_p, k_i, k_d, dt, reference = 20.0, 80.0, 0.1, table.dt, table.on_line(ANGLE, steps=400)
    controller = CrossCoupled(
        table.cascade(MISMATCHED), CrossGains(k_p, k_i, k_d), VariableCoupling()
    )
    run = simulate(table.plant, controller, reference)

    A, B, C = (np.asarray(matrix) for matrix in (table.plant.A, table.plant.B, table.plant.C))
    V = np.zeros((2, 8))
    V[0, 1] = V[1, 5] = 0.7958e-3
    k_pv, share, K = 10.0, 10.0 * dt / 0.05, np.diag(MISMATCHED)
    N = np.outer(NORMAL, NORMAL)
    # states: plant (8), velocity integrators w (2), compensator integral (1), contour error one
    # sample ago (1); input r (2)
    W = K + (k_p + k_i * dt + k_d / dt) * N
    speed_error = np.hstack(
        [-W @ C - V, np.zeros((2, 2)), NORMAL[:, None], -k_d / dt * NORMAL[:, None]]
    )
    rows_w = share * speed_error + np.hstack([np.zeros((2, 8)), np.eye(2), np.zeros((2, 2))])
    rows_u, feed_u, feed_w = k_pv * speed_error + rows_w, (k_pv + share) * W, share * W
    rows_i = np.concatenate([-k_i * dt * NORMAL @ C, [0, 0, 1, 0]])
    rows_e = np.concatenate([-NORMAL @ C, np.zeros(4)])
    F = np.vstack([np.hstack([A, np.zeros((8, 4))]) + B @ rows_u, rows_w, rows_i, rows_e])
    G = np.vstack([B @ feed_u, feed_w, k_i * dt * NORMAL, NORMAL])
    start = np.concatenate(
        [
            np.asarray(
                table.plant.initial_state(
                    np.asarray(reference.position)[0], reference.start_increment
                )
            ),
            np.zeros(4),
        ]
    )
    _, control, _ = scipy.signal.dlsim(
        (F, G, rows_u, feed_u, dt), np.asarray(reference.position)[:400], x0=start
    )
    np.testing.assert_allclose(run.control, control, rtol=0, atol=1e-9 * np.abs(control).max())


def test_variable_gains_see_the_circle_where_constant_ones_see_its_tangent(table):
    """On a circle the tangent takes the lag's sagitta e^2 / 2R for a contour error.

    Its correction pushes a late tool off the circle.
    """
    reference, excess = table.on_circle(), []
    for coupling in (VariableCoupling(), ConstantCoupling()):
        run = simulate(
            table.equal, CrossCoupled(table.cascade(), CrossGains(40.0), coupling), reference
        )
        excess.append(
            np.abs(np.linalg.norm(np.asarray(run.output)[-400:], axis=1) - table.radius).mean()
        )
    plain = simulate(table.equal, table.cascade(), reference)
    radius = np.abs(np.linalg.norm(np.asarray(plain.output)[-400:], axis=1) - table.radius).mean()
    assert excess[0] < 0.6 * radius < excess[1]


@pytest.mark.parametrize("name", ["proportional", "integral", "derivative"])
def test_bad_gains_are_one_line(name):
    for value in (-1.0, np.nan):
        with pytest.raises(ValueError, match=name):
            CrossGains(**{"proportional": 1.0, name: value})
