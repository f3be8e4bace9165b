"""Metrics by the GPU's kernel against the readable ones; without a GPU it is interpreted."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.devices import on_gpu
from jcontour.geometry.contours import arc, chain, circle, line, polygon
from jcontour.kernels.gpu.lanes import Operand
from jcontour.kernels.gpu.metric_lanes import lane_metrics
from jcontour.motion.references import along
from jcontour.simulation.evaluation import member, stack_references
from jcontour.simulation.metrics import SEARCH_REACH, score_signals

SQUARE = polygon([(0.0, 0.0), (2e-2, 0.0), (2e-2, 2e-2), (0.0, 2e-2)])
WAY = chain([line([0.0, 0.0], [3e-3, 0.0]), arc([3e-3, 0.0], [3e-3, 2e-3], 2.0)])


def case(contours, steps: int, runs: int):
    """References, and random signals y (m, T, run, reference), u (p, T, run, reference).

    Errors are from a micrometre to the size of the contour. One run has a NaN in its control, one
    in its output.
    """
    random = np.random.default_rng(0)
    laws = [(path, np.linspace(0.0, 0.99 * float(path.length), steps)) for path in contours]
    references = stack_references([along(path, law, 1e-3, 3, at_rest=False) for path, law in laws])
    shape = 2, steps, runs, len(contours)
    far = np.geomspace(1e-6, 1e-2, runs)[:, None]
    wanted = np.asarray(references.position)[:, :steps].transpose(2, 1, 0)[:, :, None]
    y, u = wanted + far * random.standard_normal(shape), random.standard_normal(shape)
    y[0, 5, 1, 0] = u[1, 6, 0, 0] = np.nan
    return references, y, u


def both(references, y, u, window):
    """Metrics (run, reference) of the kernel, and the readable ones."""

    @jax.jit
    def by_lanes(references, y, u):
        def last(leaf):
            return Operand(jnp.moveaxis(leaf, 0, -1), (1,))

        given = jax.tree.map(last, references)
        operands = Operand(y, (0, 1)), Operand(u, (0, 1))
        return [number.array for number in lane_metrics(SEARCH_REACH, window, *operands, given)]

    readable = jax.jit(partial(score_signals, window=window))
    signals = [np.moveaxis(rows, (-1, 0), (0, -1)) for rows in (y, u)]
    apart = jax.device_get(references)
    found = [readable(*(rows[k] for rows in signals), member(apart, k)) for k in range(y.shape[-1])]
    wanted = [
        np.stack(numbers, axis=-1) for numbers in zip(*map(jax.tree.leaves, found), strict=True)
    ]
    return by_lanes(references, y, u), wanted


def check(found, wanted, tolerance):
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, other, rtol=tolerance)


@pytest.mark.slow
def test_equal_to_the_readable_metrics():
    references, y, u = case([SQUARE, WAY], 9, 3)
    found, wanted = both(references, y, u, (1, 8))
    check(found, wanted, 1e-11)
    assert np.isnan(np.asarray(found[0])[1, 0])
    assert found[-1].tolist() == wanted[-1].astype(float).tolist() != np.zeros((3, 2)).tolist()


@pytest.mark.slow
@pytest.mark.parametrize("window", [(0, 70), (20, 21)])
def test_stretches_of_a_long_run(window):
    references, y, u = case([circle(2e-3), SQUARE, WAY], 70, 4)
    check(*both(references, y, u, window), 1e-11)


@pytest.mark.skipif(not on_gpu(), reason="no GPU")
def test_many_runs_on_a_gpu():
    references, y, u = case([circle(2e-3), SQUARE, WAY], 500, 3000)
    found, wanted = both(references, y, u, (3, 450))
    check(found, wanted, 1e-10)
    again, _ = both(references, y, u, (3, 450))
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(found, again, strict=True))
