"""Limits that a controller keeps its own memory within, as the integrator of a cascade.

They are found from its step: far away from zero an entry that is kept within a limit comes back at
the limit, whichever way and however far. Then the step with limits is compared with that without
them, kept to what was found.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jcontour.analysis.frozen_loops import unlimited
from jcontour.controller import Controller

FAR = 1e12  # of every number that is remembered and measured
TRIES = 200  # memories and measurements on which the limits are compared, of 1e-3 up to FAR
SAME = 1e-9  # of the largest number of a try


def memory_limits(
    controller: Controller, plan: Any, memory: Any, measurement: Any
) -> tuple[Float[np.ndarray, " n"] | None, bool]:
    """Limit of every entry of the memory, +-, and whether limits do nothing else to it.

    None where there are none; infinite for an entry without one.

    Args:
        controller: whose step is affine but for its limits.
        plan: one row.
        memory: what it may remember; floats are tried, the rest stays.
        measurement: likewise.
    """
    free = unlimited(controller)
    if eqx.tree_equal(*jax.device_get((controller, free))):
        return None, True
    moving, fixed = eqx.partition((memory, measurement), eqx.is_inexact_array)
    flat, unravel = ravel_pytree(moving)

    @eqx.filter_jit
    def stepped(one: Controller, numbers: Float[Array, "tries numbers"]) -> Float[Array, "tries n"]:
        def step(row: Float[Array, " numbers"]) -> Float[Array, " n"]:
            after, _ = one.step(*_between(plan, eqx.combine(unravel(row), fixed)))
            return ravel_pytree(eqx.filter(after, eqx.is_inexact_array))[0]

        return jax.vmap(step)(numbers)

    random = np.random.default_rng(0)
    away = FAR * random.normal(size=flat.size)
    ends = np.asarray(stepped(controller, jnp.asarray([away, 2 * away, -away])))
    found = (ends[0] == ends[1]) & (ends[0] == -ends[2]) & (ends[0] != 0.0)
    kept = np.where(found, np.abs(ends[0]), np.inf)
    sizes = 10.0 ** random.uniform(-3.0, np.log10(FAR), (TRIES, 1))
    numbers = jnp.asarray(sizes * random.normal(size=(TRIES, flat.size)))
    after, without = (np.asarray(stepped(one, numbers)) for one in (controller, free))
    apart = np.abs(after - np.clip(without, -kept, kept))
    exact = bool((apart <= SAME * np.abs(without).max(axis=1, keepdims=True, initial=0.0)).all())
    return (kept if found.any() else None), exact


def _between(plan: Any, both: tuple[Any, Any]) -> tuple[Any, Any, Any]:
    """Memory, plan, measurement: what a step takes."""
    memory, measurement = both
    return memory, plan, measurement
