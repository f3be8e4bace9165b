"""A whole program, millions of servo steps, in one call: gains and closed loop chunk by chunk.

A chunk knows the state it starts in and the samples that it and its preview see. Inside it the
closed loop is affine,

    x(k+1) = M_k x(k) + v_k,   M_k = A - B F_k,   v_k = B f_k,
and (M_2, v_2) after (M_1, v_1) is (M_2 M_1, M_2 v_1 + v_2): on a GPU all states come from an
associative scan over time, on a CPU from a plain one. Only signals are kept; the derivative
computes a chunk again, so its memory is that of one chunk as well.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.controller import Controller
from jcontour.devices import on_gpu
from jcontour.linear.plant import AffinePlan, LinearPlant
from jcontour.motion.references import Reference
from jcontour.simulation.closed_loop import check_run, start_state

CHUNK = 2**16  # steps; their gains are 10 MB for 8 states and 2 inputs


class Signals(NamedTuple):
    """Signals that a run is scored from; row k is taken before control k acts.

    See `metrics.score_signals`.
    """

    output: Float[Array, "T m"]
    control: Float[Array, "T p"]


@eqx.filter_jit
def run_program(
    plant: LinearPlant, controller: Controller, reference: Reference, chunk: int = CHUNK
) -> Signals:
    """Outputs and controls of `simulate`, for a linear plant under gains made from the preview.

    The whole state is measured.

    Args:
        plant: the machine.
        controller: whose plan is an `AffinePlan`, its row k made from samples k..k+N_p, such as
            `ContouringLQ` and `PreviewLQ`.
        reference: the whole program.
        chunk: steps that are prepared together.

    Raises:
        ValueError: the plant or the controller is of another kind, the chunk is not positive, or as
            `simulate`.
    """
    check_run(plant, controller, reference)
    if type(plant) is not LinearPlant:
        raise ValueError(
            f"plant: a long program needs a LinearPlant, received {type(plant).__name__}; "
            "use simulate"
        )
    if chunk < 1:
        raise ValueError(f"chunk: needs at least one step, received {chunk}")
    count = -(-reference.steps // chunk)
    length = -(-reference.steps // count)
    seen = length + controller.preview
    missing = max((count - 1) * length + seen - reference.position.shape[0], 0)

    def padded(values):
        return jnp.pad(values, ((0, missing), *[(0, 0)] * (values.ndim - 1)), mode="edge")

    samples = [padded(values) for values in _timed(reference)]

    @jax.checkpoint
    def one_chunk(state, first):
        own = [jax.lax.dynamic_slice_in_dim(values, first, seen) for values in samples]
        part = Reference(*own, reference.start_increment, reference.contour, reference.dt, length)
        plan = controller.prepare(part)
        if not isinstance(plan, AffinePlan) or controller.initial_memory(part) is not None:
            raise ValueError(
                "controller: a long program needs gains alone, "
                f"{type(controller).__name__} makes more; use simulate"
            )
        states, state = closed_loop(plant, plan, state)
        control = plan.f - jnp.einsum("kpn,kn->kp", plan.F, states)
        return state, Signals(states @ plant.C.T, control)

    _, signals = jax.lax.scan(one_chunk, start_state(plant, reference), length * jnp.arange(count))
    return jax.tree.map(lambda rows: rows.reshape(-1, rows.shape[-1])[: reference.steps], signals)


def closed_loop(
    plant: LinearPlant, plan: AffinePlan, state: Float[Array, " n"]
) -> tuple[Float[Array, "T n"], Float[Array, " n"]]:
    """States before every control of a plan, and the state after the last."""
    M, v = plant.A[None] - plant.B @ plan.F, plan.f @ plant.B.T
    states = _all_at_once(M, v, state) if on_gpu() else _one_by_one(M, v, state)
    return jnp.concatenate([state[None], states[:-1]]), states[-1]


def _one_by_one(
    M: Float[Array, "T n n"], v: Float[Array, "T n"], state: Float[Array, " n"]
) -> Float[Array, "T n"]:
    """States after every step."""

    def step(state, row):
        state = row[0] @ state + row[1]
        return state, state

    return jax.lax.scan(step, state, (M, v))[1]


def _all_at_once(
    M: Float[Array, "T n n"], v: Float[Array, "T n"], state: Float[Array, " n"]
) -> Float[Array, "T n"]:
    """States after every step, by composing the steps pair by pair."""

    def after(first, second):
        maps = jnp.einsum("kij,kjl->kil", second[0], first[0], precision="highest")
        return maps, jnp.einsum("kij,kj->ki", second[0], first[1], precision="highest") + second[1]

    maps, offsets = jax.lax.associative_scan(after, (M, v))
    return jnp.einsum("kij,j->ki", maps, state, precision="highest") + offsets


def _timed(reference: Reference) -> tuple[Array, Array, Array, Array]:
    return reference.position, reference.tangent, reference.arc, reference.mask
