"""The bent reference against dense matrices of a NumPy loop, and the largest of a family."""

import jax.numpy as jnp
import numpy as np
import pytest
from qpsolvers import solve_qp
from scipy.optimize import minimize

from jcontour.geometry.contours import circle
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_gains
from jcontour.motion.references import along
from jcontour.plants.encoders import Encoders
from jcontour.simulation.evaluation import stack_plants
from tests.small_loops import Proportional
from tuning.precompensation import (
    FIRST,
    GROWTH,
    INSIDE,
    Bounds,
    Copy,
    Prices,
    bend_back,
    bend_of,
    eased,
    precompensate,
)

DT, GAIN = 1e-3, 60.0
PRICES = Prices(contouring=0.9, size=1e-3, roughness=1e-2)


@pytest.fixture(scope="module")
def controller():
    return Proportional(GAIN)


@pytest.fixture(scope="module")
def table():
    """Two axes driven by their speed, which lags by a few samples."""
    A = np.kron(np.eye(2), [[1.0, DT], [0.0, 0.8]])
    return LinearPlant(A, np.kron(np.eye(2), [[0.0], [0.2]]), np.kron(np.eye(2), [[1.0, 0]]), DT)


def seen(plants):
    return stack_plants([Encoders(plant) for plant in plants])


def arc(steps, moving=1000):
    """Of so many samples, of which the first ones move."""
    return along(circle(1e-2), 5e-5 * np.minimum(np.arange(steps), moving - 1), DT, 0, at_rest=True)


class Dense:
    """Weighted errors of a loop as matrices: W^(1/2) (p - y), its mean square, and their slopes."""

    def __init__(self, plant, reference, held=(), roughness=1e-2):
        steps = reference.steps
        A, B, C = (np.asarray(one) for one in (plant.A, plant.B, plant.C))
        wanted = np.asarray(reference.position)[:steps]
        first = np.asarray(plant.initial_state(wanted[0], np.zeros(2)))

        def tool(p):
            x, iterates = first, []
            for target in p:
                iterates.append(C @ x)
                x = A @ x + B @ (GAIN * (target - C @ x))
            return np.array(iterates)

        roots = []
        for k, t in enumerate(np.asarray(reference.tangent)[:steps]):
            normal = np.array([-t[1], t[0]])
            rests = k > 0 and np.array_equal(wanted[k], wanted[k - 1])
            along_it = 1.0 if rests else np.sqrt(0.1)
            roots.append(np.outer(normal, normal) + along_it * np.outer(t, t))
        root = np.zeros((2 * steps, 2 * steps))
        for k, one in enumerate(roots):
            root[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = one / np.sqrt(steps)
        still = tool(wanted)
        columns = []
        for index in range(2 * steps):
            shift = np.zeros(2 * steps)
            shift[index] = 1.0
            columns.append((tool(wanted + shift.reshape(-1, 2)) - still).ravel())
        inside = np.ones(2 * steps)
        inside[[0, 1, -2, -1]] = 0.0  # both ends stay
        inside[[2 * k + axis for k in held for axis in (0, 1)]] = 0.0
        self.error = root @ (wanted - still).ravel()
        self.slope = -root @ np.stack(columns, axis=1) * inside
        padded = np.pad(np.eye(steps), ((2, 2), (0, 0)))  # no shift before and after
        D = np.kron(np.diff(padded, 2, axis=0), np.eye(2)) * inside
        self.price = (1e-3 * np.eye(2 * steps) + roughness * D.T @ D) / steps

    def least(self):
        """Correction of the least cost (T, 2)."""
        quadratic = self.slope.T @ self.slope + self.price
        return -np.linalg.solve(quadratic, self.slope.T @ self.error).reshape(-1, 2)


@pytest.mark.parametrize(("moving", "held"), [(35, ()), (1000, (20, 21, 22, 23, 40))])
def test_where_it_rests_or_is_held_the_rest_is_the_minimum(table, controller, moving, held):
    """An error along a reference that rests counts in full: the tool comes late, none may pass."""
    reference, stays = arc(60, moving), np.isin(np.arange(60), held)
    wanted = Dense(table, reference, held).least()
    plants = seen([table])
    corrected = precompensate(plants, controller, reference, PRICES, rounds=12, held=stays)
    assert np.array_equal(
        ~corrected.correction.any(axis=1), stays | np.isin(np.arange(60), (0, 59))
    )
    np.testing.assert_allclose(corrected.correction, wanted, atol=1e-4 * np.abs(wanted).max())


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.5, 0.05])  # of the largest bend that it would like
def test_within_bounds_it_is_nearly_the_minimum_of_its_quadratic_program(table, controller, share):
    reference = arc(40)
    dense = Dense(table, reference)
    scale = 1e5  # corrections in 10 um, which a solver likes better
    quadratic, linear = dense.slope.T @ dense.slope + dense.price, dense.slope.T @ dense.error
    free = np.flatnonzero(dense.slope.any(axis=0))  # the ends stay
    bend = np.kron(np.diff(np.pad(np.eye(40), ((1, 1), (0, 0))), 2, axis=0), np.eye(2))
    reach = share * np.abs(bend @ np.linalg.solve(quadratic, linear)).max() * np.ones((40, 2))
    middle = 0.2 * reach * np.random.default_rng(0).uniform(-1, 1, reach.shape)
    reach[30:] = np.inf

    def cost(c):
        return np.sum((dense.error + dense.slope @ c) ** 2) + c @ dense.price @ c

    def least(inside):
        """Of the corrections that keep a part of the reach."""
        rows = np.flatnonzero(np.isfinite(reach.ravel()))
        low, high = ((middle + sign * inside * reach).ravel()[rows] for sign in (-1, 1))
        corrected = solve_qp(
            quadratic[np.ix_(free, free)],
            scale * linear[free],
            np.vstack([bend[rows][:, free], -bend[rows][:, free]]),
            scale * np.concatenate([high, -low]),
            solver="daqp",
        )
        whole = np.zeros(80)
        whole[free] = corrected / scale
        return cost(whole)

    bounds = Bounds(middle, reach)
    corrected = precompensate(
        seen([table]), controller, reference, PRICES, rounds=200, bounds=bounds
    )
    assert bounds.keep(corrected.correction) and not bounds.keep(2 * corrected.correction)
    assert least(1.0) <= cost(corrected.correction.ravel()) <= 1.02 * least(INSIDE)
    assert least(INSIDE) < 0.9 * cost(np.zeros(80))


def test_bounds_that_are_not_kept_in_time_leave_the_reference_as_it_is(table, controller):
    bounds = Bounds(np.full((40, 2), 1e-3), np.full((40, 2), 1e-6))  # not even by a straight one
    corrected = precompensate(seen([table]), controller, arc(40), PRICES, rounds=1, bounds=bounds)
    assert not corrected.correction.any()
    np.testing.assert_array_equal(corrected.after, corrected.before)


@pytest.mark.slow
def test_the_worst_of_a_family_is_nearly_as_good_as_it_can_be(table, controller):
    reference = arc(24)
    family = [with_input_gains(table, gains) for gains in ([1.0, 1.0], [1.3, 0.7], [0.6, 1.2])]
    loops = [Dense(plant, reference) for plant in family]

    def largest(correction):
        return max(np.linalg.norm(one.error + one.slope @ correction) for one in loops)

    minimax, mean = (
        precompensate(seen(family), controller, reference, PRICES, rounds=rounds)
        for rounds in (40, 1)
    )
    assert minimax.after.max() == pytest.approx(largest(minimax.correction.ravel()), rel=1e-9)
    assert minimax.weight.sum() == pytest.approx(1.0)
    # the same by a general method: the least bound of all squares, and the prices
    error, slope = 1e4, 1e1  # errors in 0.1 mm, corrections in mm
    price = slope**2 * loops[0].price

    def left(c, one):
        return error * one.error + slope * one.slope @ c

    def cost(c):
        return max(np.sum(left(c, one) ** 2) for one in loops) + c @ price @ c

    within = [
        {
            "type": "ineq",
            "fun": lambda z, one=one: z[-1] - np.sum(left(z[:-1], one) ** 2),
            "jac": lambda z, one=one: np.append(-2 * slope * one.slope.T @ left(z[:-1], one), 1.0),
        }
        for one in loops
    ]
    start, even = (1e3 * one.correction.ravel() for one in (minimax, mean))
    best = minimize(
        lambda z: z[-1] + z[:-1] @ price @ z[:-1],
        np.append(even, 1.01 * cost(even)),
        jac=lambda z: np.append(2 * price @ z[:-1], 1.0),
        method="SLSQP",
        constraints=within,
        options={"maxiter": 500, "ftol": 1e-10},
    )
    assert cost(start) == pytest.approx(cost(best.x[:-1]), rel=1e-4)
    assert cost(start) < 0.9 * cost(even)


@pytest.mark.parametrize(
    ("prices", "rounds", "message"),
    [
        (Prices(size=-1.0), 1, "size: needs to be finite and not negative"),
        (Prices(roughness=np.nan), 1, "roughness: needs to be finite"),
        (Prices(contouring=1.5), 1, "contouring: needs to be from zero to one"),
        (Prices(), 0, "rounds: needs at least one"),
    ],
)
def test_bad_prices_are_named(table, controller, prices, rounds, message):
    with pytest.raises(ValueError, match=message):
        precompensate(seen([table]), controller, arc(10), prices, rounds)


STEPS, AXES = 9, 2


def matrix():
    return np.diff(np.pad(np.eye(STEPS), ((1, 1), (0, 0))), 2, axis=0)


def rows(seed=0):
    return np.random.default_rng(seed).normal(size=(STEPS, AXES))


def test_the_second_difference_and_its_transpose():
    np.testing.assert_allclose(bend_of(jnp.asarray(rows())), matrix() @ rows(), atol=1e-14)
    np.testing.assert_allclose(bend_back(jnp.asarray(rows())), matrix().T @ rows(), atol=1e-14)


def test_eased_is_the_inverse_of_a_square():
    size, rough = 1.3, 40.0
    root = np.sqrt(size) * np.eye(STEPS) - np.sqrt(rough) * matrix()
    smoothed = eased(jnp.asarray(rows()), jnp.asarray(size), jnp.asarray(rough))
    np.testing.assert_allclose(
        smoothed, np.linalg.solve(root @ root, rows()), rtol=1e-10, atol=1e-12
    )


def test_bounds_hold_the_bend_beside_its_middle():
    middle, reach = rows(1), np.full((STEPS, AXES), 0.5)
    bounds = Bounds(middle, reach)
    for share, kept in ((0.99, True), (1.01, False)):
        correction = np.linalg.solve(matrix(), middle + share * reach)
        assert bounds.keep(correction) is kept
    reach[:] = np.inf
    assert bounds.keep(1e6 * rows()) and not bounds.are_some


def test_what_the_copy_keeps_is_inside_and_has_room_for_no_bend():
    middle, reach = np.array([[0.0], [3.0], [-3.0]]), np.array([[2.0], [2.0], [2.0]])
    least, most = Bounds(middle, reach).inner
    np.testing.assert_allclose(least.ravel(), [-2 * INSIDE, 0.0, -3 - 2 * INSIDE])
    np.testing.assert_allclose(most.ravel(), [2 * INSIDE, 3 + 2 * INSIDE, 0.0])


def test_without_bounds_the_copy_is_the_bend_and_costs_nothing():
    free = Bounds.none(STEPS, AXES)
    least, most = (jnp.asarray(edge) for edge in free.inner)
    copy = Copy.of(free)
    for seed in range(3):
        copy = copy.after(jnp.asarray(rows(seed)), (least, most))
        assert float(copy.penalty) == 0.0
        np.testing.assert_allclose(copy.multiplier, 0.0, atol=1e-14)


def test_a_bend_that_stays_outside_pushes_ever_more():
    """The bend 2 beyond a bound of 1: what pushes it back, penalty times multiplier, grows."""
    bounds = Bounds(np.zeros((1, 1)), np.ones((1, 1)))
    within = tuple(jnp.asarray(edge) for edge in bounds.inner)
    copy, pushes = Copy.of(bounds), []
    assert float(copy.penalty) == FIRST
    for _ in range(5):
        copy = copy.after(jnp.full((1, 1), 2.0), within)
        assert abs(float(copy.place[0, 0])) <= INSIDE
        pushes.append(float(copy.penalty * copy.multiplier[0, 0]))
    assert np.all(np.diff(pushes) > 0) and float(copy.penalty) == pytest.approx(GROWTH**5 * FIRST)
    inside = copy.after(jnp.full((1, 1), 0.98), within)  # between those of the copy and its own
    assert float(inside.penalty) == float(copy.penalty)
