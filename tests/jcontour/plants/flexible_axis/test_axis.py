from dataclasses import fields

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.wrappers.filters import Filtered, notch
from jcontour.geometry.contours import line
from jcontour.linear.plant import decoupled_axes
from jcontour.motion.point_to_point import PointToPoint, ToAndFro, thesis_task_a, thesis_task_b
from jcontour.motion.references import in_time
from jcontour.plants.flexible_axis.axis import (
    AxisParameters,
    FlexibleAxis,
    Motion,
    SmoothFlexibleAxis,
    euler_model,
    thesis_axis,
    zoh_model,
)
from jcontour.plants.friction import Friction
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import simulate
from tests.reference_data import numbers_of

DATA = numbers_of("single_axis/trajectories")["trajectories"]
DT = 1e-3
K_PP, K_PV, T_IV = 30.0, 55.67, 0.04  # thesis, section 3.4.2


def in_a_loop(axis, task, filtered=False):
    """A run under the thesis's cascade."""
    loops = Cascade(CascadeGains(K_PP, K_PV, T_IV), motors(1), DT)
    controller = Filtered(loops, notch(87.0, 0.85, 0.05, DT), 1) if filtered else loops
    return jax.device_get(simulate(axis, controller, task))


@pytest.mark.parametrize("row", DATA, ids=[row["name"] for row in DATA])
def test_reference_trajectories(row):
    """Of the axis, its cascade and its notch."""
    task = thesis_task_b() if row["name"].startswith("B") else thesis_task_a()
    run = in_a_loop(FlexibleAxis(thesis_axis(), DT), task, "notch" in row["name"])
    states, every = np.concatenate(run.state.motion, axis=1), row["every"]
    np.testing.assert_allclose(states[::every], row["X"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.control[:-1, 0][::every], row["U"], rtol=0, atol=1e-8)
    away = states[:, 2] - np.asarray(task.position)[:-1, 0]
    np.testing.assert_allclose(1e3 * np.abs(away).mean(), row["ee_mean_mm"], rtol=1e-8)


@pytest.mark.parametrize("kind", [FlexibleAxis, SmoothFlexibleAxis])
def test_without_friction_it_is_the_linear_equation(kind, ideal):
    """Against an adaptive integrator of higher order."""
    axis = kind(ideal(), DT)
    start = Motion(*(np.array([value]) for value in (0.0, 0.2, 0.001, -0.1)))
    state = (
        start
        if kind is SmoothFlexibleAxis
        else axis.initial_state(np.zeros(1), np.ones(1))._replace(motion=start)
    )
    state = eqx.filter_jit(
        lambda state: jax.lax.fori_loop(0, 300, lambda _, s: axis.step(s, jnp.array([0.5])), state)
    )(state)

    def rates(_, x):
        link = 2908.0 * (x[0] - x[2]) + 2.1 * (x[1] - x[3])
        return [x[1], (79.33 * 0.5 - link) / 39.62, x[3], link / 0.38]

    exact = solve_ivp(
        rates, (0, 0.3), [0.0, 0.2, 0.001, -0.1], method="DOP853", rtol=1e-12, atol=1e-14
    ).y[:, -1]
    np.testing.assert_allclose(
        np.concatenate(getattr(state, "motion", state)), exact, rtol=1e-7, atol=1e-9
    )


def by_the_rules(p, dt, wanted, substep=5e-5):
    """States and currents under the thesis's cascade, one number at a time.

    It follows the reference description.
    """
    M, m, k, c = (float(value[0]) for value in (p.motor_mass, p.tool_mass, p.stiffness, p.damping))
    k_t, tau = float(p.force_constant[0]), float(p.pole_pitch[0])
    f_c, f_s, v_s, b_v = (
        float(v[0])
        for v in (
            p.friction.coulomb,
            p.friction.stribeck,
            p.friction.stribeck_speed,
            p.friction.viscous,
        )
    )
    S, C = (np.asarray(rows)[0] for rows in (p.cogging_sine, p.cogging_cosine))
    angles = 2 * np.pi / tau * np.arange(1, S.size + 1)

    def drive(x, u):
        return (
            k_t * u
            - S @ np.sin(angles * x[0])
            - C @ np.cos(angles * x[0])
            - k * (x[0] - x[2])
            - c * (x[1] - x[3])
        )

    def rates(x, u, mode):
        link = k * (x[0] - x[2]) + c * (x[1] - x[3])
        friction = mode * (f_c + f_s / (1 + (x[1] / v_s) ** 2)) + b_v * x[1]
        return np.array(
            [x[1], (drive(x, u) - friction) / M, x[3], link / m] if mode else [0, 0, x[3], link / m]
        )

    x, mode, integral, states, currents = np.array([wanted[0], 0, wanted[0], 0.0]), 0, 0.0, [], []
    for r in wanted:
        error = K_PP * (r - x[0]) - x[1]
        integral += dt * error
        u = K_PV * (error + integral / T_IV)
        states.append(x)
        currents.append(u)
        for _ in range(round(dt / substep)):
            if mode == 0 and abs(drive(x, u)) > f_c + f_s:
                mode = int(np.sign(drive(x, u)))
            k1 = rates(x, u, mode)
            k2 = rates(x + substep / 2 * k1, u, mode)
            k3 = rates(x + substep / 2 * k2, u, mode)
            x = x + substep / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + substep * k3, u, mode))
            if mode * x[1] <= 0:
                x, mode = x * [1, 0, 1, 1], 0
    return np.array(states), np.array(currents)


OTHERS = {
    "half stiffness": (1e-3, {"stiffness": 1454.0}, PointToPoint(0.01, 0.1, 4.0)),
    "s-curve at 4 kHz": (2.5e-4, {}, PointToPoint(0.01, 0.2, 6.0, 300.0)),
    "to and fro, all else different": (
        2.5e-4,
        {
            "motor_mass": 12.0,
            "tool_mass": 1.5,
            "damping": 8.0,
            "force_constant": 30.0,
            "pole_pitch": 0.03,
            "cogging_sine": [5.0, -2.0],
            "cogging_cosine": [1.0, 3.0],
            "friction": (8.0, 5.0, 0.05, 40.0),
        },
        ToAndFro(0.01, 25.0),
    ),
}


@pytest.mark.parametrize(("dt", "changes", "law"), OTHERS.values(), ids=OTHERS)
def test_other_axes_and_tasks_go_by_the_rules(dt, changes, law):
    """Stick, slip and reversal included: with the library's own cascade and references."""
    thesis = thesis_axis()
    named = {field.name: getattr(thesis, field.name) for field in fields(thesis)} | changes
    if "friction" in changes:
        named["friction"] = Friction(*changes["friction"])
    parameters = AxisParameters(**named)
    task = in_time(line([0.0], [0.01]), law, 0.3, dt, dwell=0.01)
    run = simulate(
        FlexibleAxis(parameters, dt), Cascade(CascadeGains(K_PP, K_PV, T_IV), motors(1), dt), task
    )
    states, currents = by_the_rules(parameters, dt, np.asarray(task.position)[:-1, 0])
    np.testing.assert_allclose(np.concatenate(run.state.motion, axis=1), states, rtol=0, atol=1e-11)
    np.testing.assert_allclose(run.control[:, 0], currents, rtol=0, atol=1e-9)
    sticks = np.asarray(run.state.mode)[:, 0]
    assert (sticks == 0).any() and (sticks == 1).any()


def after_one(axis, position, increment, control):
    """State one sample after the start."""
    return jax.device_get(_after_one(axis, position, increment, control))


@eqx.filter_jit
def _after_one(axis, position, increment, control):
    return axis.step(axis.initial_state(position, increment), control)


def test_a_slider_below_break_away_does_not_move_and_above_does():
    axis = FlexibleAxis(
        eqx.tree_at(
            lambda p: (p.cogging_sine, p.cogging_cosine), thesis_axis(), replace_fn=jnp.zeros_like
        ),
        DT,
    )
    held = after_one(axis, np.zeros(1), np.zeros(1), np.array([58.39 / 79.33]))
    assert held.motion.motor == 0 and held.mode == 0
    moved = after_one(axis, np.zeros(1), np.zeros(1), np.array([58.41 / 79.33]))
    assert moved.motion.motor > 0 and moved.mode == 1


def test_it_comes_to_rest_and_sticks():
    axis = FlexibleAxis(thesis_axis(), DT)
    state = axis.initial_state(np.zeros(1), np.array([1e-4]))
    state = eqx.filter_jit(
        lambda state: jax.lax.fori_loop(0, 400, lambda _, s: axis.step(s, jnp.zeros(1)), state)
    )(state)
    assert not np.any(np.asarray(state.mode)) and not np.any(np.asarray(state.motion.motor_speed))


def test_axes_side_by_side_are_single_axes(ideal):
    plain = eqx.tree_at(
        lambda p: (p.cogging_sine, p.cogging_cosine),
        ideal(),
        replace_fn=lambda c: jnp.zeros((1, 3)),
    )
    single = [thesis_axis(), plain]
    pair = jax.tree.map(lambda *leaves: np.concatenate(leaves), *single)
    both = FlexibleAxis(pair, DT)
    control = np.array([1.5, -0.4])
    state = after_one(both, np.array([0.01, 0.02]), np.array([1e-4, 0.0]), control)
    for k, (parameters, position, increment) in enumerate(
        [(single[0], 0.01, 1e-4), (single[1], 0.02, 0.0)]
    ):
        alone = FlexibleAxis(parameters, DT)
        after = after_one(alone, np.array([position]), np.array([increment]), control[k : k + 1])
        for name in Motion._fields:
            np.testing.assert_allclose(
                getattr(state.motion, name)[k],
                getattr(after.motion, name)[0],
                rtol=1e-13,
                atol=1e-16,
            )


def test_the_smooth_twin_comes_near_the_true_axis():
    task = thesis_task_a()

    def error(axis):
        return np.sqrt(np.mean((in_a_loop(axis, task).output - task.position[:-1]) ** 2))

    true = error(FlexibleAxis(thesis_axis(), DT))
    gaps = [abs(error(SmoothFlexibleAxis(thesis_axis(), DT, s)) / true - 1) for s in (50.0, 1e3)]
    assert gaps[1] < 0.03 and gaps[1] < gaps[0]


@pytest.mark.parametrize(
    "name", ["motor_mass", "tool_mass", "force_constant", "pole_pitch", "stiffness", "damping"]
)
def test_bad_parameters_are_named(name, ideal):
    with pytest.raises(ValueError, match=f"^{name}:"):
        ideal(**{name: -1.0})


def test_bad_axes_are_named(ideal):
    with pytest.raises(ValueError, match="cogging_cosine"):
        ideal(cogging_cosine=[0.0, 1.0])
    with pytest.raises(ValueError, match="cogging_sine: every entry"):
        ideal(cogging_sine=[np.nan])
    with pytest.raises(
        ValueError, match="stiffness: needs one value, or one for each of 1 axes, received 2"
    ):
        ideal(stiffness=[1e3, 2e3])
    with pytest.raises(ValueError, match="does not divide"):
        FlexibleAxis(ideal(), 1.3e-4)
    for count in (0, 2.5):
        with pytest.raises(
            ValueError, match=f"substeps: needs a whole number of at least 1, received {count}"
        ):
            FlexibleAxis(ideal(), DT, count)
    with pytest.raises(ValueError, match="dt"):
        SmoothFlexibleAxis(ideal(), 0.0)


MODELS_DATA = numbers_of("single_axis/models")


@pytest.mark.parametrize(("name", "make"), [("euler", euler_model), ("zoh", zoh_model)])
def test_thesis_models(name, make):
    model, wanted = make(thesis_axis(), DT), MODELS_DATA[name]
    np.testing.assert_allclose(model.A, wanted["A"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.asarray(model.B)[:, 0], wanted["B"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        np.sort(np.abs(np.linalg.eigvals(model.A))), wanted["abs_eig_A"], rtol=0, atol=1e-12
    )
    np.testing.assert_array_equal(model.C, [[0, 0, 1, 0]])


def test_two_axes_are_the_plant_without_dry_friction(two_flexible_axes):
    model, axis = (
        zoh_model(two_flexible_axes, DT),
        FlexibleAxis(two_flexible_axes, DT, substeps=200),
    )
    state, control = (
        axis.initial_state(np.array([0.01, 0.02]), np.array([1e-4, -2e-4])),
        jnp.array([0.7, -0.3]),
    )
    after = axis.step(state, control)
    np.testing.assert_allclose(
        model.step(jnp.concatenate(state.motion), control),
        np.concatenate(after.motion),
        rtol=1e-9,
        atol=1e-12,
    )
    np.testing.assert_allclose(
        model.initial_state(np.array([0.01, 0.02]), np.array([1e-4, -2e-4])),
        np.concatenate(state.motion),
        atol=1e-9,
    )


def test_axes_stay_decoupled_under_traced_parameters(two_flexible_axes):
    seen = []
    jax.jit(lambda parameters: seen.append(zoh_model(parameters, DT).pattern))(two_flexible_axes)
    axes = decoupled_axes(seen[0])
    assert [axis.states for axis in axes] == [(0, 2, 4, 6), (1, 3, 5, 7)] and axes[1].inputs == (1,)
