"""Gains and runs of any linear machine in kernels against plain JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour import _kernels as kernels
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.lq.scheduled_lq import BlockwiseLQ
from jcontour.geometry.contours import circle, polyline
from jcontour.linear.plant import LinearPlant, Pattern, steady_motion
from jcontour.linear.transformations import with_input_gains
from jcontour.motion.references import along
from jcontour.plants import bridgeport
from jcontour.simulation.evaluation import evaluate, stack_plants, stack_references

pytest.importorskip("warp", reason="the extra fast is not installed")

STEPS, N = 60, 4
WEIGHTS = np.array([1.0, 5.0, 1e-10])
PROFILE = np.array([0.5, 1.0, 1.5, 2.0])


@pytest.fixture(scope="module")
def case():
    """A machine that does not say that its axes are decoupled, a family of it, and two runs."""
    table = bridgeport()
    every = Pattern(*(tuple((True,) * M.shape[1] for _ in M) for M in (table.A, table.B, table.C)))
    motion = steady_motion(table)
    plants = [
        LinearPlant(one.A, one.B, one.C, one.dt, every, motion)
        for one in (table, with_input_gains(table, [0.9, 1.1]))
    ]
    arc = 4e-5 * np.arange(STEPS)
    corner = polyline([[0.0, 0.0], [1e-3, 0.0], [1e-3, 2e-3]])
    scored = np.arange(STEPS) % 7 != 3
    runs = [
        along(circle(0.02), arc, table.dt, N, at_rest=False),
        along(corner, arc, table.dt, N, at_rest=True, scored=scored),
    ]
    return plants[0], stack_plants(plants), stack_references(runs)


def numbers(case, law, weights, profile=None):
    """Numbers of all runs, (reference, machine, number)."""
    model, family, references = case
    actual = evaluate(family, law(model, LQWeights(*weights, profile), N), references, (5, 50))
    return jnp.stack(jax.tree.leaves(actual)[:-2], axis=-1)


def by(monkeypatch, asked, function, *arguments):
    monkeypatch.setenv(kernels.SWITCH, asked)
    assert kernels.enabled() == (asked == "1")
    return jax.device_get(jax.jit(function)(*arguments))


@pytest.mark.parametrize("law", [ContouringLQ, BlockwiseLQ])
def test_metrics_are_those_of_plain_jax(monkeypatch, case, law):
    profile = PROFILE if law is ContouringLQ else None

    def many(scales):
        return jax.vmap(lambda scale: numbers(case, law, scale * WEIGHTS, profile))(scales)

    scales = np.array([[1.0, 1.0, 1.0], [0.2, 2.0, 0.1]])
    actual, wanted = (by(monkeypatch, asked, many, scales) for asked in "10")
    assert actual.shape == (2, 2, 2, 10)
    assert np.max(np.abs(actual - wanted) / np.maximum(np.abs(wanted), 1e-9)) < 1e-9


def test_slopes_are_those_of_plain_jax(monkeypatch, case):
    def error(logarithms):
        return jnp.sum(numbers(case, ContouringLQ, WEIGHTS * jnp.exp(logarithms))[..., 0])

    actual, wanted = (by(monkeypatch, asked, jax.grad(error), np.zeros(3)) for asked in "10")
    np.testing.assert_allclose(actual, wanted, rtol=1e-8, atol=1e-8 * np.max(np.abs(wanted)))
