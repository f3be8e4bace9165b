"""The norm-optimal law against dense matrices, and its iteration against laps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.controllers.learning.laps import laps_of, learn
from jcontour.controllers.learning.norm_optimal import NormOptimal, linearised, norm_optimal

STEPS = 120


@pytest.fixture(scope="module")
def run(small_loop, positions):
    plant, controller, reference = small_loop(STEPS)
    return laps_of(lambda lap: plant, controller, reference, positions), reference


def dense(linear, steps, axes):
    """Matrix of a linear function of signals."""
    inputs = np.eye(steps * axes).reshape(-1, steps, axes)
    return np.asarray(jax.jit(jax.vmap(linear))(inputs)).reshape(steps * axes, -1).T


@pytest.mark.slow
def test_the_update_is_the_minimum(run):
    """The normal equations with dense matrices, weights written out sample by sample."""
    laps, reference = run
    law = norm_optimal(laps, reference, contouring=0.8, effort=0.2, size=0.01)
    random = np.random.default_rng(0)
    c, e = random.standard_normal((2, STEPS, 2))
    G = dense(law.model, STEPS, 2)
    W = np.zeros_like(G)
    for k, t in enumerate(np.asarray(reference.tangent[:STEPS])):
        W[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.eye(2) - 0.8 * np.outer(t, t)
    left = G.T @ W @ G + 0.21 * np.eye(2 * STEPS)
    change = np.linalg.solve(left, G.T @ W @ e.ravel() - 0.01 * c.ravel())
    actual = eqx.filter_jit(law.update)(c, e)
    np.testing.assert_allclose(actual, c + change.reshape(STEPS, 2), rtol=0, atol=1e-7)


def test_the_model_is_the_difference_of_two_runs(run):
    laps, _ = run
    start, change = np.random.default_rng(1).standard_normal((2, STEPS, 2))
    model = linearised(laps, jnp.zeros((STEPS, 2)))
    lap = np.zeros((), int)
    ahead, before = (laps(placed(c), lap).error for c in (start + change, start))
    np.testing.assert_allclose(model(change), before - ahead, rtol=0, atol=1e-12)


def test_learning_removes_the_contour_error_first(run):
    laps, reference = run
    law = norm_optimal(laps, reference)
    actual, _ = learn(laps, law, 6, jnp.zeros((STEPS, 2)))
    t = np.asarray(reference.tangent[:STEPS])
    normal = np.stack([-t[:, 1], t[:, 0]], axis=1)
    across = np.sqrt(np.mean(np.sum(np.asarray(actual.error) * normal, axis=2) ** 2, axis=1))
    along = np.sqrt(np.mean(np.sum(np.asarray(actual.error) * t, axis=2) ** 2, axis=1))
    assert np.all(np.diff(across) < 0) and across[5] < 0.02 * across[0]
    assert across[1] / across[0] < 0.5 * along[1] / along[0]


@pytest.mark.parametrize(
    ("prices", "says"),
    [
        ({"contouring": 1.5}, "contouring: needs to be from zero to one"),
        ({"contouring": -0.5}, "contouring: needs to be finite and at least zero"),
        ({"effort": 0.0}, "effort: needs to be above zero"),
        ({"size": np.nan}, "size: needs to be finite"),
    ],
)
def test_bad_prices(prices, says):
    with pytest.raises(ValueError, match=says):
        NormOptimal(lambda c: c, np.ones((5, 1)), **prices)
