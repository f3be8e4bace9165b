"""Filters, observers and the poles of whole loops against python-control.

None of its mathematics is shared.
"""

from functools import cache

import control
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.state_feedback import StateFeedback, lq_gain, moving_target
from jcontour.controllers.observers.disturbance_observer import (
    DisturbanceObserver,
    ReducedObserver,
    thesis_gain,
)
from jcontour.controllers.observers.extended_state_observers import (
    CurrentLESO,
    DisturbanceRejection,
    Estimate,
    EulerLESO,
    ExactLESO,
)
from jcontour.controllers.wrappers.filters import Filtered, low_pass, notch
from jcontour.geometry.contours import line
from jcontour.motion.references import along
from jcontour.plants.encoders import Sensed
from jcontour.plants.flexible_axis.axis import thesis_axis, zoh_model
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import prepared

DT, W, B0 = 1e-3, 87.0, 79.33 / 39.62
K_PP, K_PV, T_IV = 30.0, 55.67, 0.04
MOTOR = np.eye(4)[:2]
STEP = np.ones(300)


@cache
def model():
    return zoh_model(thesis_axis(), DT)


@cache
def machine():
    return Sensed(model(), lambda x: x[:2])


@cache
def cascade():
    return Cascade(CascadeGains(K_PP, K_PV, T_IV), motors(1), DT)


@cache
def ramp():
    return along(line([0.0], [0.1]), 1e-4 * np.arange(3), DT, 1, at_rest=False)


@cache
def feedback():
    gain = lq_gain(model(), jnp.diag(jnp.array([1e7, 1e3, 1e7, 1.0])), jnp.eye(1))
    return StateFeedback(gain, moving_target(model()))


FILTERS = {  # how to make it, the analogue one, the frequency [rad/s] at which they agree
    "notch": (
        lambda: notch(W, 0.85, 0.05, DT),
        ([1, 2 * 0.85 * 0.05 * W, W**2], [1, 2 * 0.05 * W, W**2]),
        None,
    ),
    "prewarped notch": (
        lambda: notch(900.0, 0.2, 0.3, DT, prewarp=True),
        ([1, 108.0, 900.0**2], [1, 540.0, 900.0**2]),
        900.0,
    ),
    "low pass": (lambda: low_pass(500.0, 0.7, DT), ([500.0**2], [1, 700.0, 500.0**2]), 500.0),
}


@pytest.mark.parametrize(("make", "analogue", "prewarp"), FILTERS.values(), ids=FILTERS)
def test_filters(make, analogue, prewarp):
    """Frequency response up to Nyquist, poles, step response."""
    actual = jax.jit(make)()
    warped = {} if prewarp is None else {"prewarp_frequency": prewarp}
    wanted = control.c2d(control.tf(*analogue), DT, "tustin", **warped)
    ours = control.tf(np.asarray(actual.numerator), [1.0, *np.asarray(actual.denominator)], DT)
    z = np.exp(1j * DT * np.geomspace(1.0, 0.999 * np.pi / DT, 50))
    np.testing.assert_allclose(ours(z), wanted(z), rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        np.sort_complex(ours.poles()), np.sort_complex(wanted.poles()), rtol=0, atol=1e-9
    )
    step = lambda memory, x: actual.step(memory, x)  # noqa: E731
    stepped = jax.jit(lambda x: jax.lax.scan(step, np.zeros(2), x)[1])(STEP)
    np.testing.assert_allclose(
        stepped, control.forced_response(wanted, U=STEP).outputs, rtol=0, atol=1e-9
    )


def estimates(observer, controls, positions):
    """Estimates (T, 3) of an observer that starts at zero.

    Row k is the estimate at k, from what was before it and the position there.
    """

    def step(carry, sample):
        estimate, control, before = carry
        now = observer.update(estimate, control, before, sample[1:])
        return (now, sample[:1], sample[1:]), jnp.concatenate(now)

    none = np.zeros(1)
    start = Estimate(none, none, none), none, none
    rows = np.stack([controls, positions], axis=1)
    return np.asarray(jax.jit(lambda rows: jax.lax.scan(step, start, rows)[1])(rows))


@pytest.mark.parametrize(("kind", "method"), [(ExactLESO, "zoh"), (EulerLESO, "euler")])
def test_extended_state_observers(kind, method):
    """(2.10) from [u, y] to its three states, discretised by python-control, under noise."""
    w = 350.0
    F, G = (
        [[-3 * w, 1, 0], [-3 * w**2, 0, 1], [-(w**3), 0, 0]],
        [[0, 3 * w], [B0, 3 * w**2], [0, w**3]],
    )
    wanted = control.c2d(control.ss(F, G, np.eye(3), np.zeros((3, 2))), DT, method)
    u, y = np.random.default_rng(0).standard_normal((2, 300)) * [[1.0], [1e-3]]
    response = control.forced_response(wanted, U=np.stack([u, y])).outputs.T
    np.testing.assert_allclose(
        estimates(kind(w, B0, DT), u, y),
        response,
        rtol=1e-9,
        atol=1e-9 * np.abs(response).max(axis=0).min(),
    )
    tuned = control.poles(wanted)
    np.testing.assert_allclose(
        np.poly(tuned),
        np.poly([np.exp(-w * DT) if method == "zoh" else 1 - w * DT] * 3),
        rtol=0,
        atol=1e-9,
    )


def poles(controller):
    """Poles of the loop of the machine and a controller: the Jacobian of one sample."""
    plant, reference = machine(), ramp()
    plan = jax.tree.map(lambda rows: np.asarray(rows)[0], prepared(controller, reference))
    start = eqx.filter_jit(plant.initial_state)
    flat, unravel = ravel_pytree(
        (
            start(np.asarray(reference.position)[0], reference.start_increment),
            controller.initial_memory(reference),
        )
    )

    def step(z):
        state, memory = unravel(z)
        memory, control = controller.step(memory, plan, plant.measure(state))
        return ravel_pytree((plant.step(state, control), memory))[0]

    return np.linalg.eigvals(np.asarray(jax.jit(jax.jacfwd(step))(flat)))


def closed(*blocks):
    """Poles of the negative feedback loop through these blocks, the first at its input.

    They are by python-control in state space.
    """
    around = blocks[0]
    for block in blocks[1:]:
        around = block * around
    return control.feedback(around, control.ss([], [], [], np.eye(1), DT)).poles()


def same(actual, wanted):
    """Equal as sets, zeros of the bookkeeping aside."""
    actual, wanted = (p[np.abs(p) > 1e-6] for p in (actual, wanted))
    assert actual.size == wanted.size
    for pole in wanted:
        assert np.abs(actual - pole).min() < 1e-9
    return True


@cache
def axis():
    """The axis, from current to what its motor measures."""
    A, B = (np.asarray(matrix) for matrix in (model().A, model().B))
    return control.ss(A, B, MOTOR, np.zeros((2, 1)), DT)


PI = control.tf2ss(control.tf([K_PV * (1 + DT / T_IV), -K_PV], [1, -1], DT))
SPEED = control.ss([], [], [], [[K_PP, 1.0]], DT)


def test_poles_of_the_cascade_behind_a_notch():
    make, analogue, _ = FILTERS["notch"]
    notched = control.tf2ss(control.c2d(control.tf(*analogue), DT, "tustin"))
    assert same(poles(Filtered(cascade(), make(), 1)), closed(axis(), SPEED, PI, notched))


def test_poles_of_disturbance_rejection():
    """The current estimator of the motor as a double integrator, closed by hand.

    xi+ = (I - l C)(A xi + b u) + l y+
    """
    w, p = 300.0, np.exp(-0.3)
    A, b = (
        np.array([[1, DT, DT**2 / 2], [0, 1, DT], [0, 0, 1]]),
        B0 * np.array([[DT**2 / 2], [DT], [0]]),
    )
    gain = np.array([[1 - p**3], [3 * (1 - p) ** 2 * (1 + p) / (2 * DT)], [(1 - p) ** 3 / DT**2]])
    correct, M, B = np.eye(3) - gain @ [[1.0, 0, 0]], np.asarray(model().A), np.asarray(model().B)
    # state [x(k), integral, xi(k)], all updated at the sample: u = PI(x, integral) - zeta / b0
    error = np.array([[-K_PP, -1.0, 0, 0]])
    law = np.hstack(
        [K_PV * error, np.array([[K_PV / T_IV]]), [[0, 0, -1 / B0]]]
    )  # of [x, integral(k), xi]
    x_next = np.hstack([M, np.zeros((4, 4))]) + B @ law
    integral_next = np.hstack([np.zeros((1, 4)), [[1.0]], np.zeros((1, 3))]) + DT * error @ x_next
    xi_next = correct @ (np.hstack([np.zeros((3, 5)), A]) + b @ law) + gain @ x_next[:1]
    wanted = np.linalg.eigvals(np.vstack([x_next, integral_next, xi_next]))
    assert same(poles(DisturbanceRejection(cascade(), CurrentLESO(w, B0, DT), motors(1))), wanted)


def test_poles_of_a_disturbance_observer():
    """The disturbance observer solved for u: u = (u_inside - Q P_n^-1 x_m) / (1 - Q).

    From u = u_inside - d and d = Q (P_n^-1 x_m - u); it has twice the states of the loop.
    """
    w = 120.0
    D = np.poly(np.exp(DT * np.roots([1.0, np.sqrt(2) * w, w**2])))
    low_passed = D.sum() / 2 * np.array([1.0, 1.0])
    inverse = control.tf2ss(control.tf(D.sum() / (B0 * DT**2) * np.array([1.0, -2.0, 1.0]), D, DT))
    rest = control.tf2ss(control.tf(D, np.polysub(D, low_passed), DT))
    wanted = closed(axis(), PI * SPEED + inverse * control.ss([], [], [], [[1.0, 0.0]], DT), rest)
    actual = poles(DisturbanceObserver(cascade(), motors(1), w, B0, DT))
    twice = np.roots(D)  # what 1 / (1 - Q) cancels
    assert same(np.concatenate([actual, twice]), wanted)


def test_poles_of_the_reduced_observer():
    A, B = np.asarray(model().A), np.asarray(model().B)
    wanted = np.concatenate(
        [
            np.linalg.eigvals(A - B @ np.asarray(feedback().gain)),
            np.linalg.eigvals(A[2:, 2:] - thesis_gain() @ A[:2, 2:]),
        ]
    )
    assert same(poles(ReducedObserver(feedback(), model(), thesis_gain())), wanted)
