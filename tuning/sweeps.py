"""Many designs at once: metrics (design, contour, plant) of a batch of weights.

The preview is an integer that shapes the program, so it is swept by the caller, one compiled
program each.
"""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import Batching, evaluate, platform_batching
from jcontour.simulation.metrics import Metrics
from tuning.parameters import Weights


@eqx.filter_jit
def sweep(
    build: Callable[[Weights], Controller],
    designs: Weights,
    plants: Plant,
    references: Reference,
    window: tuple[int, int] | None = None,
    batching: Batching | None = None,
) -> Metrics:
    """Metrics with axes (design, contour, plant); a diverged design is flagged, not dropped.

    Args:
        build: weights -> controller.
        designs: weights stacked on axis 0, see `grid` and `random_sample`.
        plants: the family, stacked.
        references: the contours, stacked.
        window: samples a..b-1 that are scored; all when not given.
        batching: how designs are batched, on one device or on several (`devices.Spread`); chosen by
            the platform when not given.
    """
    batching = platform_batching() if batching is None else batching
    return batching(lambda weights: evaluate(plants, build(weights), references, window), designs)


def grid(**values: Sequence[float | int]) -> dict[str, Float[Array, " D"]]:
    """Every combination of the named values, the last name fastest.

    `LQWeights(**grid(...))` is a batch of designs.

    >>> {name: column.tolist() for name, column in grid(alpha=[1, 2], rho=[0.1]).items()}
    {'alpha': [1.0, 2.0], 'rho': [0.1, 0.1]}

    Raises:
        ValueError: a name has no values.
    """
    for name, row in values.items():
        if not len(row):
            raise ValueError(f"{name}: needs at least one value to sweep, received none")
    mesh = np.meshgrid(*(np.asarray(row, float) for row in values.values()), indexing="ij")
    return {name: jnp.asarray(column.ravel()) for name, column in zip(values, mesh, strict=True)}


def random_sample(
    count: int, seed: int, **ranges: tuple[float, float]
) -> dict[str, Float[Array, " D"]]:
    """`count` designs, each value drawn on a logarithmic scale between two positive bounds.

    >>> sample = random_sample(3, seed=0, alpha=(0.1, 10.0))
    >>> sample["alpha"].shape
    (3,)

    Raises:
        ValueError: the count is below one, or bounds are not positive and in order.
    """
    if count < 1:
        raise ValueError(f"count: needs at least one design, received {count}")
    for name, (low, high) in ranges.items():
        if not 0 < low <= high < np.inf:
            raise ValueError(
                f"{name}: needs bounds with 0 < low <= high, received {low} and {high}"
            )
    random = np.random.default_rng(seed)
    return {
        name: jnp.asarray(np.exp(random.uniform(np.log(low), np.log(high), count)))
        for name, (low, high) in ranges.items()
    }


def design(designs: Weights, index: int) -> Weights:
    """One design of a batch."""
    return jax.tree.map(lambda leaf: leaf[index], designs)
