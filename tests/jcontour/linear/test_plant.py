import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag as block

from jcontour.linear.plant import (
    LARGEST_SUMMED,
    LinearPlant,
    Pattern,
    check_stable,
    decoupled_axes,
    small_product,
    spectral_radius,
    steady_motion,
)
from jcontour.linear.transformations import with_input_delay
from jcontour.plants.linear_machines import bridgeport


@pytest.mark.parametrize("delay", [2, 0])
def test_steady_motion_goes_on_as_a_ramp_under_a_constant_control(delay, run):
    plant = with_input_delay(bridgeport(), delay)
    y, dy = np.array([3e-3, -2e-3]), np.array([2.5e-5, 1e-5])
    x = np.asarray(plant.initial_state(y, dy))
    # an axis of n states is held for n steps; its poles are printed to four digits
    for i, steps in enumerate((3 + delay, 5 + delay)):
        forced = run(plant, np.zeros(plant.states), np.tile(np.eye(2)[i], (steps, 1)))[1][:, i]
        free = run(plant, x, np.zeros((steps, 2)))[1][:, i]
        ramp = y[i] + np.arange(steps + 1) * dy[i]
        u = (ramp - free) @ forced / (forced @ forced)
        np.testing.assert_allclose(free + u * forced, ramp, rtol=0, atol=1e-14)


def test_steady_motion_of_true_integrators_never_ends(two_axes, run):
    y, dy = np.array([3e-3, -2e-3]), np.array([2.5e-5, 1e-5])
    x = np.asarray(two_axes.initial_state(y, dy))
    u = dy / np.array(
        [2e-4 + 8e-4 * 0.4 / 0.4, 3e-4 + 7e-4 * 0.5 / 0.5]
    )  # ramp gain of each axis, by hand
    outputs = run(two_axes, x, np.tile(u, (200, 1)))[1]
    np.testing.assert_allclose(outputs, y + np.arange(201)[:, None] * dy, rtol=0, atol=1e-14)
    at_rest = np.asarray(two_axes.initial_state(y, np.zeros(2)))
    np.testing.assert_allclose(
        run(two_axes, at_rest, np.zeros((50, 2)))[1], np.tile(y, (51, 1)), rtol=0, atol=1e-15
    )


def test_a_standstill_of_an_identified_axis_stands():
    """An integrator, two lags and a mode, of a record: the last row holds the place."""
    a = np.array([1.268806, 1.044535, 1.012565, 1.220204e-2, 3.458538e-5, 0.0])
    b = 1e-6 * np.array([0.1299651, 1.174275, 3.569026, 4.544617, 2.187219, 0.01335138])
    A = np.eye(6) + 0.4729073 * np.eye(6, k=1) - np.outer(a, np.eye(6)[0])
    axis = with_input_delay(LinearPlant(A, b[:, None], np.eye(1, 6), 1e-3), 4)
    rest = np.asarray(axis.initial_state(np.ones(1), np.zeros(1)))
    assert np.abs(np.asarray(axis.A) @ rest - rest).max() < 1e-12


def test_steady_motion_is_differentiable_where_the_pattern_is_given(two_axes):
    @jax.jit
    def start(A):
        return jnp.sum(
            steady_motion(LinearPlant(A, two_axes.B, two_axes.C, 1e-3, two_axes.pattern)).Sv
        )

    # more states need more samples to tell the ramp: the derivative to the lag of X, against a
    # difference
    h = np.zeros((4, 4))
    h[1, 1] = 1e-6
    A = np.asarray(two_axes.A)
    slope = float(np.asarray(jax.jit(jax.grad(start))(A))[1, 1])
    difference = float(start(A + h)) - float(start(A - h))
    assert slope == pytest.approx(difference / 2e-6, rel=1e-6)


def test_steady_motion_refuses_what_it_cannot_solve(coupled_plant):
    with pytest.raises(ValueError, match=r"outputs \[0, 1\] hang .*import SteadyMotion$"):
        steady_motion(coupled_plant(0, 3, 2))
    hidden = LinearPlant(
        block([[0.5, 0.0], [0.0, 0.5]]), [[1.0], [1.0]], [[1.0, 1.0]], 1.0
    )  # the two states look the same
    with pytest.raises(ValueError, match="output 0.*steady motion"):
        steady_motion(hidden)


@settings(max_examples=40)
@given(st.lists(st.integers(1, 4), min_size=1, max_size=3), st.randoms(use_true_random=False))
def test_decoupled_axes_are_found_however_the_plant_is_ordered(sizes, order):
    """A chain of states per axis, linked one by one, with states, inputs and outputs shuffled."""
    axes, n = len(sizes), sum(sizes)
    A = block(*(np.eye(s) + np.eye(s, k=-1) for s in sizes))
    B, C = block(*(np.eye(s)[:, :1] for s in sizes)), block(*(np.eye(s)[-1:] for s in sizes))
    states, inputs, outputs = (order.sample(range(k), k) for k in (n, axes, axes))
    actual = decoupled_axes(
        Pattern.of(A[np.ix_(states, states)], B[np.ix_(states, inputs)], C[np.ix_(outputs, states)])
    )
    owner = np.repeat(np.arange(axes), sizes)
    assert [axis.outputs for axis in actual] == [(i,) for i in range(axes)]
    for i, axis in enumerate(actual):
        assert axis.inputs == (inputs.index(outputs[i]),)
        assert axis.states == tuple(
            k for k, state in enumerate(states) if owner[state] == outputs[i]
        )


def test_steady_motion_of_a_permuted_plant(two_axes):
    states, inputs, outputs = [3, 0, 2, 1], [1, 0], [0, 1]
    A, B, C = (np.asarray(m) for m in (two_axes.A, two_axes.B, two_axes.C))
    shuffled = LinearPlant(
        A[np.ix_(states, states)], B[np.ix_(states, inputs)], C[np.ix_(outputs, states)], 1e-3
    )
    plain, mixed = steady_motion(two_axes), steady_motion(shuffled)
    np.testing.assert_allclose(mixed.Sy, np.asarray(plain.Sy)[states], atol=1e-15)
    np.testing.assert_allclose(mixed.Sv, np.asarray(plain.Sv)[states], rtol=1e-12, atol=1e-15)


def test_pattern_is_hashable_and_full_where_values_are_traced(two_axes):
    assert hash(two_axes.pattern) == hash(Pattern.of(two_axes.A, two_axes.B, two_axes.C))
    traced = []
    jax.eval_shape(
        lambda A: traced.append(LinearPlant(A, two_axes.B, two_axes.C, 1e-3).pattern), two_axes.A
    )
    assert np.all(traced[0].A) and not np.all(traced[0].B)


def test_spectral_radius_is_infinite_for_what_is_not_finite():
    M = np.stack(
        [np.diag([0.5, -2.0]), np.full((2, 2), np.nan), np.array([[0.0, 1.0], [-1.0, 0.0]])]
    )
    np.testing.assert_allclose(spectral_radius(M), [2.0, np.inf, 1.0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"A": np.zeros((2, 3))}, r"A: needs to be square.*\(2, 3\)"),
        ({"B": np.zeros((3, 1))}, r"B: needs shape \(2, p\).*\(3, 1\)"),
        ({"C": np.zeros((1, 3))}, r"C: needs shape \(m, 2\).*\(1, 3\)"),
        ({"A": np.array([[1.0, np.nan], [0.0, 1.0]])}, "A: every entry needs to be finite"),
        ({"dt": 0.0}, "dt: the sample period"),
        ({"A": 1j * np.eye(2)}, "^A: needs real numbers, received complex ones"),
    ],
)
def test_bad_matrices_are_named(change, words):
    good = {"A": np.eye(2), "B": np.ones((2, 1)), "C": np.ones((1, 2)), "dt": 1e-3}
    with pytest.raises(ValueError, match=words):
        LinearPlant(**{**good, **change})


def test_integers_become_floats():
    plant = LinearPlant([[1, 0], [0, 1]], [[1], [0]], [[1, 0]], 1)
    assert plant.A.dtype == plant.B.dtype == plant.C.dtype == jnp.float64
    assert (plant.states, plant.inputs, plant.axes, plant.dt) == (2, 1, 1, 1.0)


def test_unstable_matrices_are_named_with_their_eigenvalues():
    check_stable("loop", np.diag([0.5, -0.999]))
    jax.jit(lambda M: check_stable("loop", M))(2 * np.eye(2))  # traced: not looked at
    for matrix, values in (
        (np.diag([0.5, -1.5]), "0.5 +-1.5"),
        ([[1.0, 1.0], [0.0, 1.0]], "1. +1."),
        ([[np.nan]], "not finite"),
    ):
        needed = "needs all eigenvalues inside the unit circle"
        words = f"^loop is not stable: {needed}, they are .{{0,2}}{values}"
        with pytest.raises(ValueError, match=words):
            check_stable("loop", np.asarray(matrix))


@pytest.mark.parametrize("shape", [(3, 2), (1, 1), (2, LARGEST_SUMMED + 1)])
def test_products_of_any_size(shape):
    random = np.random.default_rng(0)
    M, x = random.standard_normal(shape), random.standard_normal(shape[1])
    np.testing.assert_allclose(small_product(M, x), M @ x, rtol=1e-13)


@pytest.mark.parametrize("size", [3, 40])
@pytest.mark.parametrize("shape", [(1,), (2,), (2, 1)])
def test_another_shape_is_refused_and_never_stretched(size, shape):
    with pytest.raises(TypeError, match="x: needs shape|parameter 'x'"):
        small_product(np.ones((2, size)), np.ones(shape))
