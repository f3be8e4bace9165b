"""Random problems that the tests of all kernels share."""

from functools import partial
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.linear.plant import LinearPlant
from jcontour.riccati.receding_horizon import CostToGo

# derivatives: the time goes into compiling, not running
quick = partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})


def machine(sizes: tuple[int, ...], inputs: int, outputs: int) -> LinearPlant:
    """A stable plant of decoupled parts, its states shuffled so that the parts interleave."""
    random, n = np.random.default_rng(sum(sizes)), sum(sizes)
    A, B, C = np.zeros((n, n)), np.zeros((n, inputs)), np.zeros((outputs, n))
    first = 0
    for part, size in enumerate(sizes):
        own = slice(first, first + size)
        block = random.standard_normal((size, size))
        A[own, own] = 0.9 * block / np.abs(np.linalg.eigvals(block)).max()
        B[own, part :: len(sizes)] = random.standard_normal(
            (size, len(range(part, inputs, len(sizes))))
        )
        C[part :: len(sizes), own] = random.standard_normal(
            (len(range(part, outputs, len(sizes))), size)
        )
        first += size
    order = random.permutation(n)
    return LinearPlant(A[np.ix_(order, order)], B[order], C[:, order], 1e-3)


def data(plant: LinearPlant, steps: int, preview: int):
    random = np.random.default_rng(1)
    n, p, m = plant.states, plant.inputs, plant.axes

    def positive(*shape):
        root = random.standard_normal((*shape, shape[-1]))
        return root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(shape[-1])

    terminal = CostToGo(positive(steps, n), random.standard_normal((steps, n)))
    stage = random.uniform(0.5, 2.0, preview)
    return jax.tree.map(
        jnp.asarray,
        (
            positive(steps + preview, m),
            random.standard_normal((steps + preview, m)),
            stage,
            positive(p),
            terminal,
        ),
    )


def close(first, second, tolerance):
    for one, other in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True):
        np.testing.assert_allclose(
            one, other, rtol=0, atol=tolerance * max(1e-300, float(np.abs(other).max()))
        )


@pytest.fixture(scope="session")
def problems():
    """machine, data, close and quick."""
    return SimpleNamespace(machine=machine, data=data, close=close, quick=quick)
