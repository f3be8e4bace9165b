"""What all contouring schemes keep to; what each does is in its own test file."""

import control
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal
from scipy.optimize import brentq

from jcontour._arrays import placed
from jcontour.controllers.contouring.schemes import (
    CommandShaped,
    ConstantCoupling,
    CrossCoupled,
    CrossGains,
    PathFrame,
    Precompensated,
    TaskFrame,
    VariableCoupling,
)
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.geometry.contours import circle, spline
from jcontour.motion.references import along, from_samples
from jcontour.plants.flexible_axis.axis import AxisParameters, SmoothFlexibleAxis
from jcontour.plants.friction import Friction
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import prepared, simulate

SCHEMES = {
    "cross-coupled": lambda cascade, k: CrossCoupled(
        cascade, CrossGains(5.0 * k, 20.0 * k, 0.05 * k), ConstantCoupling()
    ),
    "cross-coupled-variable": lambda cascade, k: CrossCoupled(
        cascade, CrossGains(5.0 * k, 20.0 * k, 0.05 * k), VariableCoupling()
    ),
    "task-frame": lambda cascade, k: TaskFrame(
        eqx.tree_at(lambda c: c.gains.position, cascade, jnp.array([30.0, 30.0 + 9.0 * k]))
    ),
    "precompensated": lambda cascade, k: Precompensated(cascade, 4.0 * k),
    "command-shaped": lambda cascade, k: CommandShaped(cascade, 0.7 * k),
}


def flexible_pair():
    """Two different flexible axes, smooth, with cogging and friction."""
    friction = Friction([36.0, 20.0], [22.0, 10.0], [2.8, 1.0], [250.0, 150.0])
    cogging = [[4.0, 1.0], [2.0, 3.0]]
    parameters = AxisParameters(
        [40.0, 20.0],
        [0.4, 0.6],
        [2900.0, 5000.0],
        [2.0, 3.0],
        [80.0, 50.0],
        friction,
        cogging,
        cogging,
        0.0875,
    )
    return SmoothFlexibleAxis(parameters, 1e-3, substeps=4)


def flexible_cascade():
    return Cascade(
        CascadeGains(np.array([30.0, 30.0]), np.array([55.0, 40.0]), 0.04, 0.3, 0.2, 1.0, 0.1),
        Sensors((0, 1), (2, 3)),
        1e-3,
    )


@pytest.mark.parametrize("clockwise", [False, True])
def test_contour_error_of_a_circle(clockwise):
    """On the circle through r, r - y = e has c'e = (|y|^2 - R^2) / 2R.

    It is positive to the left of the path on a clockwise turn.
    """
    random = np.random.default_rng(0)
    for angle in random.uniform(0, 2 * np.pi, 5):
        sign, radius = -1.0 if clockwise else 1.0, 0.03
        radial = np.array([np.cos(angle), np.sin(angle)])
        tangent = placed(sign * np.array([-radial[1], radial[0]]))
        frame = PathFrame(tangent, placed(np.array(sign / radius)))
        tool = radius * radial + random.normal(0, 1e-3, 2)
        expected = sign * (tool @ tool - radius**2) / (2 * radius)
        assert float(frame.contour_error(placed(radius * radial - tool))) == pytest.approx(
            expected, rel=1e-12
        )


def test_frames_along_a_reference(table):
    scheme = TaskFrame(table.cascade())
    left = prepared(scheme, table.on_circle(steps=50)).frame
    right = prepared(scheme, table.on_circle(clockwise=True, steps=50)).frame
    straight = prepared(scheme, table.on_line(0.7, steps=50)).frame
    np.testing.assert_allclose(left.curvature, 1 / table.radius, rtol=1e-12)
    np.testing.assert_allclose(right.curvature, -1 / table.radius, rtol=1e-12)
    np.testing.assert_allclose(straight.curvature, 0.0, atol=1e-12)
    np.testing.assert_allclose(
        straight.normal, np.tile([-np.sin(0.7), np.cos(0.7)], (50, 1)), rtol=1e-12
    )


@pytest.mark.parametrize("name", SCHEMES)
def test_zero_gain_is_the_plain_cascade(name):
    cascade, plant = flexible_cascade(), flexible_pair()
    reference = along(circle(0.02), 5e-5 * np.arange(150), 1e-3, 1, at_rest=False)
    plain = simulate(plant, cascade, reference)
    run = simulate(plant, SCHEMES[name](cascade, 0.0), reference)
    np.testing.assert_allclose(
        run.control, plain.control, rtol=0, atol=1e-11 * np.abs(plain.control).max()
    )
    moved = simulate(plant, SCHEMES[name](cascade, 1.0), reference)
    assert np.abs(moved.control - plain.control).max() > 1e-3 * np.abs(plain.control).max()


@pytest.mark.parametrize("scheme", [Precompensated, CommandShaped])
@pytest.mark.parametrize("gain", [-1.0, np.nan, np.inf])
def test_bad_gains_are_refused(scheme, gain):
    with pytest.raises(ValueError, match="gain: needs to be finite"):
        scheme(flexible_cascade(), gain)


@pytest.mark.parametrize("name", SCHEMES)
def test_other_than_two_axes_is_one_line(name, table):
    samples = np.zeros((20, 3))
    samples[:, 0] = np.arange(20)
    reference = from_samples(samples, np.tile([1.0, 0.0, 0.0], (20, 1)), table.dt, 1)
    with pytest.raises(ValueError, match="two axes, received 3"):
        SCHEMES[name](table.cascade(), 1.0).prepare(reference)


GAIN = 1.5


def position_response(table, k_pp=25.0, k_pv=10.0, t_iv=0.05):
    """Frequency response y / r of one axis, closed by python-control.

    The PI is k_pv + k_pv T_s / T_iv z / (z - 1).
    """
    plant, dt = table.equal, table.dt
    A, B, C = (np.asarray(m) for m in (plant.A, plant.B, plant.C))
    A, B, C = A[:4, :4], B[:4, :1], C[:1, :4]
    axis = control.ss(A, B, np.vstack([C, [0.0, 0.7958e-3, 0.0, 0.0]]), 0, dt)  # position, velocity
    w = control.tf([k_pv + k_pv * dt / t_iv, -k_pv], [1, -1], dt)
    z = np.exp(1j * table.feed / table.radius * dt)
    position, velocity = axis(z).ravel() * w(z)
    return k_pp * position / (1 + k_pp * position + velocity)


def test_the_plain_circle_is_the_frequency_response(table):
    """Radius and lag of the tool, for the table that the other test stands on."""
    response, reference = position_response(table), table.on_circle()
    tool = np.asarray(simulate(table.equal, table.cascade(), reference).output)[-1] @ [1, 1j]
    wanted = np.asarray(reference.position)[reference.steps - 1] @ [1, 1j]
    assert tool / wanted == pytest.approx(response, abs=1e-9)


def test_steady_circle_of_equal_axes(table):
    """The command runs on a circle of R - k eps.

    The tool follows it by the frequency response: one equation for eps.
    """
    response, R = position_response(table), table.radius

    def mismatch(eps):
        return (abs(response * (R - GAIN * eps)) ** 2 - R**2) / (
            2 * R
        ) - eps  # c'e of the tool is (|y|^2 - R^2) / 2R

    expected = abs(response) * (R - GAIN * brentq(mismatch, -R / 4, R / 4, xtol=1e-16))
    actual = np.linalg.norm(
        np.asarray(
            simulate(table.equal, CommandShaped(table.cascade(), GAIN), table.on_circle()).output
        )[-1]
    )
    assert actual == pytest.approx(expected, abs=1e-9)
    assert abs(actual - R) < 0.5 * abs(abs(response) - 1) * R


def test_steady_error_on_a_line_is_divided(table):
    """The error falls by 1 + k for equal lags, here by 1 + k sum n_i^2: e = e0 - k eps n."""
    normal, cascade = np.array([-np.sin(0.6), np.cos(0.6)]), table.cascade((18.0, 35.0))
    plain, actual = (
        table.last_error(table.plant, c, table.on_line(0.6))
        for c in (cascade, CommandShaped(cascade, GAIN))
    )
    assert normal @ actual == pytest.approx(normal @ plain / (1 + GAIN), rel=1e-6)


def test_is_cross_coupling_by_the_position_gain(table):
    """With equal k_pp, k on the position is k_pp k on the speed.

    The difference is kappa e / 2 in the direction.
    """
    reference = table.on_line(0.6, steps=300)
    shaped = simulate(table.plant, CommandShaped(table.cascade(), GAIN), reference)
    coupled = simulate(
        table.plant,
        CrossCoupled(table.cascade(), CrossGains(25.0 * GAIN), VariableCoupling()),
        reference,
    )
    np.testing.assert_allclose(shaped.control, coupled.control, rtol=0, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.6, 2.0])
def test_nothing_is_left_on_a_line_whatever_the_axes(table, angle):
    normal = np.array([-np.sin(angle), np.cos(angle)])
    cascade = table.cascade((18.0, 35.0), 0.3)
    plain, actual = (
        table.last_error(table.plant, c, table.on_line(angle))
        for c in (cascade, Precompensated(cascade, 8.0))
    )
    assert abs(normal @ actual) < 1e-8 and abs(normal @ plain) >= min(
        1e-4, 0.0 if angle == 0.0 else 1e-4
    )


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("feedforward", [0.0, 0.6])
def test_nothing_is_left_on_a_circle_of_equal_axes(table, clockwise, feedforward):
    reference, cascade = table.on_circle(clockwise), table.cascade(feedforward=feedforward)
    radii = [
        np.linalg.norm(np.asarray(simulate(table.equal, controller, reference).output)[-1])
        for controller in (cascade, Precompensated(cascade, 5.0))
    ]
    assert abs(radii[0] - table.radius) > 1e-5
    assert radii[1] == pytest.approx(table.radius, abs=1e-8)


def test_the_command_feed_falls_inside_of_a_curve(table):
    """The command runs on a circle of radius R - a, at 1 - kappa a of the speed."""
    reference, scheme = table.on_circle(), Precompensated(table.cascade(), 5.0)
    run = simulate(table.equal, scheme, reference)
    offset = np.asarray(run.memory.offset)[1:, None]
    frame = prepared(scheme, reference).frame
    command = (
        np.asarray(reference.position)[: reference.steps - 1]
        + offset * np.asarray(frame.normal)[:-1]
    )
    speed = np.linalg.norm(np.diff(command[-10:], axis=0), axis=1) / table.dt
    np.testing.assert_allclose(speed, table.feed * (1 - offset[-1, 0] / table.radius), rtol=1e-5)


ALONG, ACROSS = 20.0, 45.0


def test_a_turned_path_turns_the_run_of_equal_axes(table):
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    points = 0.01 * np.array([[0.0, 0.0], [1.0, 1.5], [3.0, -0.5], [4.5, 1.0]])
    outputs = []
    for path in (points, points @ turn.T):
        reference = along(
            spline(path), table.feed * table.dt * np.arange(800), table.dt, 1, at_rest=False
        )
        outputs.append(
            np.asarray(
                simulate(
                    table.equal, TaskFrame(table.cascade((ALONG, ACROSS), 0.4)), reference
                ).output
            )
        )
    np.testing.assert_allclose(outputs[1], outputs[0] @ turn.T, rtol=0, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.6, 2.0])
def test_steady_error_on_a_line_is_lag_alone(table, angle):
    """k_along (t'e) = v and n'e = 0 for any axes: the velocity loops integrate."""
    tangent = np.array([np.cos(angle), np.sin(angle)])
    error = table.last_error(
        table.plant, TaskFrame(table.cascade((ALONG, ACROSS))), table.on_line(angle)
    )
    np.testing.assert_allclose(error, table.feed / ALONG * tangent, rtol=0, atol=1e-9)


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
    actual = table.last_error(
        table.plant,
        CrossCoupled(table.cascade(MISMATCHED, share), CrossGains(k_p), coupling),
        reference,
    )
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-10)
    plain = table.last_error(table.plant, table.cascade(MISMATCHED, share), reference)
    assert normal @ actual == pytest.approx(
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
