import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from tuning.descents.quadratic_step import Model, quadratic_step

SEEDS = range(6)
PENALTY = 1e-2  # the step raises it


def random_model(seed, rows=2, values=5, limits=4, weights=3):
    """Limits that hold at z with room for some."""
    random = np.random.default_rng(seed)
    return Model(
        random.normal(size=(rows, values)),
        -random.uniform(0.0, 0.3, limits),
        random.normal(size=(rows, values, weights)),
        random.normal(size=(limits, weights)),
    )


def curved(seed, weights=3):
    root = np.random.default_rng(100 + seed).normal(size=(weights, weights))
    return 0.2 * np.eye(weights) + root @ root.T


def promised(model, H, d):
    errors = model.errors + model.error_slopes @ d
    return np.mean(errors.max(axis=1)) + 0.5 * d @ H @ d


@pytest.mark.parametrize("seed", SEEDS)
def test_the_step_is_that_of_scipy(seed):
    model, H, bound = random_model(seed), curved(seed), 0.8 * np.ones(3)
    step = quadratic_step(model, H, -bound, bound, PENALTY)
    g, v = model.errors.shape
    rows = [np.concatenate([-model.error_slopes[r, i], np.eye(g)[r]]) for r, i in np.ndindex(g, v)]
    limits = np.hstack([-model.limit_slopes, np.zeros((4, g))])
    solution = minimize(
        lambda x: np.mean(x[3:]) + 0.5 * x[:3] @ H @ x[:3],
        np.concatenate([np.zeros(3), model.errors.max(axis=1)]),
        method="SLSQP",
        bounds=[(-0.8, 0.8)] * 3 + [(None, None)] * g,
        constraints={
            "type": "ineq",
            "fun": lambda x: np.concatenate(
                [np.array(rows) @ x - model.errors.ravel(), limits @ x - model.limits]
            ),
        },
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert solution.status in (0, 8)  # 8: no further fall within its last digits
    wanted = promised(model, H, solution.x[:3])
    assert promised(model, H, step.d) == pytest.approx(wanted, abs=1e-4 * abs(step.gain))
    assert step.gain == pytest.approx(model.objective - promised(model, H, step.d), abs=1e-12)
    assert np.all(model.limits + model.limit_slopes @ step.d <= 1e-8)
    assert np.all(np.abs(step.d) <= bound)
    np.testing.assert_allclose(step.shares.sum(axis=1), 1 / g, rtol=5e-3)
    slope = np.einsum("gv,gvd->d", step.shares, model.error_slopes) + H @ step.d
    pull = slope + step.prices @ model.limit_slopes
    inside = np.abs(step.d) < 0.8 - 1e-9  # at a bound its own multiplier holds
    np.testing.assert_allclose(pull[inside], 0.0, atol=1e-7)
    slack = model.limits + model.limit_slopes @ step.d
    np.testing.assert_allclose(step.prices * slack, 0.0, atol=1e-7)


@pytest.mark.parametrize("seed", SEEDS)
def test_prices_are_slopes_of_the_promise(seed):
    model, H, bound = random_model(seed), curved(seed), 5.0 * np.ones(3)
    step, h = quadratic_step(model, H, -bound, bound, PENALTY), 1e-5
    for k in range(4):
        moved = [
            quadratic_step(
                model._replace(limits=model.limits + s * np.eye(4)[k]), H, -bound, bound, PENALTY
            )
            for s in (-h, h)
        ]
        slope = (promised(model, H, moved[1].d) - promised(model, H, moved[0].d)) / (2 * h)
        assert step.prices[k] == pytest.approx(slope, rel=5e-4, abs=1e-5)


@pytest.mark.parametrize("seed", SEEDS)
def test_an_excess_is_made_as_small_as_the_bounds_allow(seed):
    model = random_model(seed)._replace(limits=np.array([3.0, 2.0, 1.0, -1.0]))
    bound = 0.1 * np.ones(3)
    step = quadratic_step(model, curved(seed), -bound, bound, PENALTY)
    wanted = linprog(
        [0, 0, 0, 1],
        A_ub=np.hstack([model.limit_slopes, -np.ones((4, 1))]),
        b_ub=-model.limits,
        bounds=[(-0.1, 0.1)] * 3 + [(0, None)],
    )
    assert wanted.fun - 1e-9 <= step.excess
    reached = np.max(model.limits + model.limit_slopes @ step.d)
    assert reached == pytest.approx(step.excess, rel=1e-12)
    assert reached <= wanted.fun + 0.1 * (3.0 - wanted.fun) + 1e-6


def test_an_excess_within_reach_is_removed_whole_near_the_limits():
    model = random_model(0)._replace(limits=np.array([1e-5, -1.0, -1.0, -1.0]))
    step = quadratic_step(model, curved(0), -np.ones(3), np.ones(3), PENALTY)
    assert step.excess == pytest.approx(0.0, abs=1e-8)
    assert np.max(model.limits + model.limit_slopes @ step.d) <= 1e-5 * 1e-3


def test_without_limits_and_with_slopes_of_every_size():
    model = Model(
        np.zeros((1, 2)), np.zeros(0), np.array([[[1e-6, 0.0], [0.0, 1e6]]]), np.zeros((0, 2))
    )
    step = quadratic_step(model, 0.05 * np.eye(2), -np.ones(2), np.ones(2), PENALTY)
    np.testing.assert_allclose(step.d[1], 0.0, atol=1e-5)
    assert step.prices.shape == (0,) and step.excess == 0.0
