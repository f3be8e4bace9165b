"""Plans of a receding horizon and metrics under an affine plan by the kernels of `affine_kernels`.

Both are functions of JAX, as `lq_metrics` is; their derivatives are those of plain JAX.
"""

from collections.abc import Callable
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import warp as wp
from jaxtyping import Array, Float

from jcontour._kernels.affine_kernels import gain_kernel, run_kernel
from jcontour._kernels.lq_metrics import (
    REAL,
    batched_over_runs,
    computes_every_metric,
    metrics_of_rows,
    scoring_rows,
)
from jcontour._kernels.parts import BLOCK, NORMS
from jcontour.linear.plant import AffinePlan, LinearPlant
from jcontour.motion.references import Reference
from jcontour.simulation.closed_loop import start_state
from jcontour.simulation.metrics import Metrics

MOST_STATES = 8  # more do not fit into the registers of a thread
MOST_INPUTS = 4
LONGEST_SWEEP = 100  # samples: beyond, blocks are faster


def suits_sweep(model: LinearPlant, preview: int) -> bool:
    """Whether the kernel of the gains takes a machine and a horizon."""
    small = model.states <= MOST_STATES and model.inputs <= MOST_INPUTS
    return small and preview <= LONGEST_SWEEP and str(model.A.dtype) in REAL


def swept_plan(
    model: LinearPlant,
    Q: Float[Array, "S m m"],
    y_d: Float[Array, "S m"],
    stage: Float[Array | np.ndarray, " N_p"],
    R: Float[Array, "p p"],
    in_jax: Callable[..., AffinePlan],
) -> AffinePlan:
    """Plan of `riccati.receding_horizon_plan` with the output terminal; its arguments are those.

    `in_jax` gives the same plan in plain JAX, for derivatives.
    """
    dtype, (p, n) = model.A.dtype, (model.inputs, model.states)
    steps = Q.shape[0] - stage.shape[0]

    @jax.custom_jvp
    def plan(model, Q, y_d, stage, R) -> AffinePlan:
        rows = (M.astype(dtype).ravel()[:, None] for M in (Q, jnp.asarray(stage), R))
        shared = model.A.ravel(), model.B.ravel(), model.C.ravel(), y_d.ravel()
        (K,) = _gains((n, p, model.axes), str(dtype), steps)(tuple(rows), *shared)
        K = K.reshape(steps, p, n + 1)
        return AffinePlan(K[..., :-1], K[..., -1])

    @plan.defjvp
    def _(primals, tangents):
        return jax.jvp(in_jax, primals, tangents)

    return plan(model, Q, y_d, stage, R)


@lru_cache
def _gains(size: tuple[int, int, int], dtype: str, steps: int):
    n, p, _ = size
    launch = wp.jax_kernel(gain_kernel(*size, REAL[dtype]), block_dim=BLOCK)

    def call(per_run, A, B, C, y_d):
        runs = per_run[0].shape[1]
        dims = {"launch_dims": (steps, runs), "output_dims": {"K": (steps * p * (n + 1), runs)}}
        return tuple(launch(A, B, C, y_d, *per_run, **dims))

    return batched_over_runs(call)


def suits_run(plant: LinearPlant, reference: Reference) -> bool:
    """Whether the kernel of a run takes a machine and a contour: one of lines and arcs."""
    small = plant.states <= 2 * MOST_STATES and plant.inputs <= MOST_INPUTS
    lines_and_arcs = not reference.contour.newton_steps
    return computes_every_metric() and small and lines_and_arcs and str(plant.A.dtype) in REAL


def metrics(
    plan: AffinePlan,
    plant: LinearPlant,
    reference: Reference,
    window: tuple[int, int] | None,
    in_jax: Callable[[AffinePlan, LinearPlant, Reference], Metrics],
) -> Metrics:
    """Metrics of a run of `plant`, whose state is measured, under u = f - F x.

    Beside the plan its arguments are those of `lq_metrics.metrics`.
    """
    dtype = plant.A.dtype

    @jax.custom_jvp
    def primal(plan: AffinePlan, plant: LinearPlant, reference: Reference) -> Metrics:
        K = jnp.concatenate([plan.F, plan.f[..., None]], axis=-1).astype(dtype)
        model = plant.A, plant.B, plant.C, start_state(plant, reference)
        shared = [matrix.astype(dtype).ravel() for matrix in model]
        shared += scoring_rows(reference.tangent, reference.position, reference, window, dtype)
        size = plant.states, plant.inputs, plant.axes
        (rows,) = _run(size, str(dtype))((K.ravel()[:, None],), *shared)
        return metrics_of_rows(rows[:, 0], reference, window)[0]

    @primal.defjvp
    def _(primals, tangents):
        return jax.jvp(in_jax, primals, tangents)

    return primal(plan, plant, reference)


@lru_cache
def _run(size: tuple[int, int, int], dtype: str):
    launch = wp.jax_kernel(run_kernel(*size, REAL[dtype]), block_dim=BLOCK)

    def call(per_run, *shared):
        runs = per_run[0].shape[1]
        dims = {"launch_dims": runs, "output_dims": {"out": (2 * NORMS + 1, runs)}}
        return tuple(launch(*shared, *per_run, **dims))

    return batched_over_runs(call)
