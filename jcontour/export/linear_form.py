"""The linear form of a controller along a run: its law for a drive, and its plan.

An observer around a controller without memory keeps its own form: correction, gains, prediction.
Any other controller is affine in memory x and measurement y, with the matrices of its step:

    x(k+1) = A x + E y + w_k,   u = f_k - F_k x - D_k y
They are its Jacobians, and w and f its step at zero. Every operation of the step is looked at first
(`bounds.affine`): what is not affine is told. Limits that it keeps its memory within, as
against windup, are kept (`memory_limits`); its control is kept to the limit of the machine.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jcontour.analysis.frozen_loops import linear_law, unlimited
from jcontour.bounds.affine import NotAffine
from jcontour.bounds.disturbed_loop import check_linear_controller, check_planless
from jcontour.controller import Controller, Plan
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    PredictorObserver,
    with_disturbance,
)
from jcontour.export.affine_law import AffineLaw
from jcontour.export.drive_law import Correction, DriveLaw, some
from jcontour.export.memory_limits import memory_limits
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import Reference
from jcontour.simulation.closed_loop import Rollout, prepared

AT_ONCE = 4096  # samples whose Jacobians are in memory together

Observer = FilterObserver | PredictorObserver | OffsetFreeObserver


class _Steps(NamedTuple):
    """A controller's step at every sample, in the letters of the module."""

    A: Float[np.ndarray, "T n n"]
    E: Float[np.ndarray, "T n q"]
    F: Float[np.ndarray, "T p n"]
    D: Float[np.ndarray, "T p q"]
    f: Float[np.ndarray, "T p"]
    w: Float[np.ndarray, "T n"]


def linear_form(
    controller: Controller, reference: Reference, run: Rollout, limit: Float[np.ndarray, " p"]
) -> AffineLaw:
    """Law of a controller along a reference.

    Args:
        controller: as `simulate` takes it.
        reference: what the plan is made for.
        run: of the controller on that reference; the shapes of its rows and what it counts are
            taken from it, no signal.
        limit: of the machine's controls, +-; what is no observer is kept to it.

    Raises:
        NotAffine: the controller has no linear form; the message names the operation.
    """
    check_planless(controller)
    plan = prepared(controller, reference)
    if isinstance(controller, Observer) and not jax.tree.leaves(run.memory.inner):
        return _observed(controller, reference, plan)
    steps = _steps(controller, plan, run.memory, run.measurement)
    for name, matrices in (("memory", steps.A), ("measurement", steps.E)):
        if np.any(matrices != matrices[0]):
            raise NotAffine(
                f"{type(controller).__name__}: what it makes of its {name} changes along the path"
            )
    rows = (plan, run.memory, run.measurement)
    kept, exact = memory_limits(controller, *jax.tree.map(lambda leaf: leaf[0], rows))
    start = np.asarray(ravel_pytree(_floats(controller.initial_memory(reference)))[0], float)
    q, p = steps.D.shape[2], steps.f.shape[1]
    law = DriveLaw(
        dt=reference.dt,
        names=tuple(f"memory {k + 1}" for k in range(start.size)),
        measured=q,
        inputs=p,
        correction=None,
        A=some(steps.A[0]),
        B=None,
        E=some(steps.E[0]),
        limit=np.broadcast_to(np.asarray(limit, float), p),
        kept=kept,
        exact=exact,
    )
    return AffineLaw(law, start, steps.F, steps.D, steps.f, steps.w)


def _observed(controller: Observer, reference: Reference, plan: Plan) -> AffineLaw:
    """An observer, and what it feeds; the predictor's correction comes after its control."""
    memory = controller.initial_memory(reference)
    model, gain = controller.model, np.asarray(controller.gain, float)
    A, B, C = (np.asarray(matrix, float) for matrix in (model.A, model.B, _measured(controller)))
    n, p, q = *B.shape, len(C)
    steps = _steps(controller.controller, plan, None, jnp.zeros((reference.steps, n)))
    names, start = [f"state {k + 1}" for k in range(n)], np.asarray(memory.estimate, float)
    F, limit = steps.D, np.inf  # the estimate is what the inner controller measures
    if isinstance(controller, OffsetFreeObserver):
        names += [f"load on control {k + 1}" for k in range(p)]
        start = np.concatenate([start, np.zeros(p)])  # the load is unknown
        A, C = (np.asarray(part, float) for part in with_disturbance(model, C))
        B = np.concatenate([B, np.zeros((p, p))])
        F = np.concatenate([F, np.broadcast_to(np.eye(p), (reference.steps, p, p))], axis=2)
        limit = np.asarray(controller.limit, float)
    correction, E = Correction(gain, C), None
    if isinstance(controller, PredictorObserver):
        A, E, correction = A - A @ gain @ C, A @ gain, None
    law = DriveLaw(
        dt=reference.dt,
        names=tuple(names),
        measured=q,
        inputs=p,
        correction=correction,
        A=A,
        B=B,
        E=E,
        limit=np.broadcast_to(limit, p),
    )
    D, w = np.zeros((reference.steps, p, q)), np.zeros((reference.steps, start.size))
    return AffineLaw(law, start, F, D, steps.f, w)


def _measured(controller: Observer) -> Array:
    model: LinearPlant = controller.model
    return model.C if controller.measured is None else controller.measured


def _floats(tree: Any) -> Any:
    return eqx.filter(tree, eqx.is_inexact_array)


def _steps(controller: Controller, plan: Plan, memory: Any, measurement: Any) -> _Steps:
    """Jacobians of the step, and its values at zero, along a run.

    Raises:
        NotAffine: the step is not affine.
    """
    controller = unlimited(controller)
    rows = (plan, memory, measurement)
    check_linear_controller(controller, *jax.tree.map(lambda leaf: leaf[0], rows))

    @eqx.filter_jit
    def at_all(controller, rows):
        return jax.vmap(lambda row: _at_zero(controller, *row))(rows)

    steps = len(jax.tree.leaves(measurement)[0])
    found = [
        jax.tree.map(
            np.asarray, at_all(controller, jax.tree.map(lambda x, k=k: x[k : k + AT_ONCE], rows))
        )
        for k in range(0, steps, AT_ONCE)
    ]
    return _Steps(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _at_zero(controller: Controller, plan: Plan, memory: Any, measurement: Any) -> tuple:
    """The six matrices of one sample; what the memory counts stays as it is."""

    def zero(tree):
        moving, fixed = eqx.partition(tree, eqx.is_inexact_array)
        return eqx.combine(jax.tree.map(jnp.zeros_like, moving), fixed)

    memory, measurement = zero(memory), zero(measurement)
    law, _ = linear_law(controller, plan, memory, measurement)
    after, control = controller.step(memory, plan, measurement)
    w, _ = ravel_pytree(_floats(after))
    return law.W, law.E, -law.K, -law.D, control, w
