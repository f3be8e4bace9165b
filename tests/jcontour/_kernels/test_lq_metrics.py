"""Whole runs in a kernel against plain JAX: metrics and slopes; and slopes against differences."""

from functools import cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour import _kernels as kernels
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle, polyline
from jcontour.linear.transformations import with_input_gains
from jcontour.motion.references import along
from jcontour.plants import bridgeport
from jcontour.simulation.evaluation import evaluate, stack_plants, stack_references

pytest.importorskip("warp", reason="the extra fast is not installed")

STEPS, N = 60, 4
WEIGHTS = np.array([[1.0, 5.0, 1e-10], [0.2, 9.0, 1e-11]])


@pytest.fixture(scope="module")
def references():
    table = machines()[0]
    arc = 4e-5 * np.arange(STEPS)
    corner = polyline([[0.0, 0.0], [1e-3, 0.0], [1e-3, 2e-3]])
    scored = np.arange(STEPS) % 7 != 3
    return stack_references(
        [
            along(circle(0.02), arc, table.dt, N, at_rest=False),
            along(corner, arc, table.dt, N, at_rest=True, scored=scored),
        ]
    )


@cache
def machines():
    """The table, and a family of it: made before anything is traced."""
    table = bridgeport()
    mirrored = with_input_gains(table, [-1.0, -1.0])
    return table, stack_plants([table, with_input_gains(table, [0.9, 1.1])]), mirrored


def runs(references, window, weights, profile=None):
    """Numbers of all runs on two machines, (reference, machine, number), and who diverged."""
    table, family, _ = machines()
    controller = ContouringLQ(table, LQWeights(*weights, profile), N)
    actual = evaluate(family, controller, references, window)
    return jnp.stack(jax.tree.leaves(actual)[:-2], axis=-1), actual.diverged


def by(monkeypatch, asked, function, *arguments):
    monkeypatch.setenv(kernels.SWITCH, asked)
    assert kernels.enabled() == (asked == "1")
    return jax.device_get(jax.jit(function)(*arguments))


def test_runs_are_left_to_plain_jax_where_a_kernel_lacks_a_metric(monkeypatch, references):
    from jcontour._kernels import lq_metrics

    monkeypatch.setenv(kernels.SWITCH, "1")
    assert lq_metrics.computes_every_metric()
    monkeypatch.setattr(lq_metrics, "COMPUTED", lq_metrics.COMPUTED[:-1])
    monkeypatch.setattr(lq_metrics, "metrics", None)  # not called
    numbers, diverged = runs(references, None, WEIGHTS[0])
    assert np.all(np.isfinite(numbers)) and not np.any(diverged)


def close(actual, wanted, tolerance):
    scale = np.maximum(np.abs(wanted), 1e-9)
    assert np.max(np.abs(actual - wanted) / scale) < tolerance


@pytest.mark.parametrize("profile", [None, np.array([0.5, 1.0, 1.5, 2.0])])
@pytest.mark.parametrize("window", [None, (5, 50)])
def test_metrics_are_those_of_plain_jax(monkeypatch, references, window, profile):
    many = jax.vmap(partial(runs, references, window, profile=profile))
    (actual, lost), (wanted, _) = (by(monkeypatch, asked, many, WEIGHTS) for asked in "10")
    close(actual, wanted, 1e-9)
    assert actual.shape == (2, 2, 2, 10) and not lost.any()


def test_slopes_are_those_of_plain_jax_in_both_modes_and_of_differences(monkeypatch, references):
    def numbers(weights):
        return runs(references, None, weights)[0]

    for mode in (jax.jacfwd, jax.jacrev):
        actual, wanted = (by(monkeypatch, asked, mode(numbers), WEIGHTS[0]) for asked in "10")
        scale = np.max(np.abs(wanted * WEIGHTS[0]), axis=-1, keepdims=True)
        assert np.all(np.abs(actual - wanted) * WEIGHTS[0] <= 1e-8 * scale)
    monkeypatch.setenv(kernels.SWITCH, "1")
    step = 1e-5
    for which in range(3):
        change = step * WEIGHTS[0] * np.eye(3)[which]
        ends = [np.asarray(jax.jit(numbers)(WEIGHTS[0] + sign * change)) for sign in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * step)
        error = np.abs(actual[..., which] * WEIGHTS[0][which] - difference)
        assert np.all(error <= 1e-5 * np.abs(ends[0]))


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_slopes_with_a_profile_are_those_of_the_readable_form(monkeypatch, references, mode):
    profile = np.array([0.5, 1.0, 1.5, 2.0])

    def numbers(logarithms):
        scaled = jnp.concatenate([WEIGHTS[0], profile]) * jnp.exp(logarithms)
        return runs(references, (5, 50), scaled[:3], scaled[3:])[0]

    actual, wanted = (by(monkeypatch, asked, mode(numbers), np.zeros(3 + N)) for asked in "10")
    scale = np.max(np.abs(wanted), axis=-1, keepdims=True)
    assert np.all(np.abs(actual - wanted) <= 1e-8 * scale)


def test_slopes_with_other_numbers_are_those_of_the_readable_form(monkeypatch, references):
    def error(scale):
        moved = eqx.tree_at(lambda one: one.position, references, references.position * scale)
        return jnp.sum(runs(moved, None, WEIGHTS[0])[0][..., 0])

    actual, wanted = (by(monkeypatch, asked, jax.grad(error), np.array(1.0)) for asked in "10")
    np.testing.assert_allclose(actual, wanted, rtol=1e-7)


def test_a_run_that_diverges_is_told(monkeypatch, references):
    _, family, mirrored = machines()

    def lost(weights):
        law = ContouringLQ(mirrored, LQWeights(*weights), N)
        return evaluate(family, law, references).diverged

    actual, wanted = (by(monkeypatch, asked, lost, WEIGHTS[0]) for asked in "10")
    np.testing.assert_array_equal(actual, wanted)
    assert actual.any()
