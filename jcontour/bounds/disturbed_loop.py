"""Matrices of one step of the closed loop under force and encoder error, along a run.

    z(k+1) = M(k) z(k) + E(k) w(k),   y(k) = C(k) z(k),   u(k) = K(k) z(k) + D(k) n(k)
For small changes z of the plant's state and the controller's memory, with w = (force, n): the force
adds to the control that the plant receives, n to the measurement. They are Jacobians of the step
that `simulate` makes. For a loop that is affine in state and memory they hold for every change.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jcontour.analysis.frozen_loops import blocks, frozen_loop, unlimited
from jcontour.bounds.affine import NotAffine, check_affine
from jcontour.controller import Controller, Memory, Plan
from jcontour.linear.plant import spectral_radius
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import check_run, follow, prepared, start_state


class UnstableLoop(ValueError):
    """A loop without a bound; the message tells spectral radius and place."""


class DisturbedLoop(NamedTuple):
    """Matrices of the module along a run, and the run itself without disturbance.

    Attributes:
        M: of the step.
        E: columns of force, then those of the measurement's error.
        C: of the tool's position.
        K: of the control.
        D: of the control, columns of the measurement's error alone.
        output: y of the undisturbed run [m].
        control: u of the undisturbed run.
    """

    M: Float[Array, "T N N"]
    E: Float[Array, "T N d"]
    C: Float[Array, "T m N"]
    K: Float[Array, "T p N"]
    D: Float[Array, "T p q"]
    output: Float[Array, "T m"]
    control: Float[Array, "T p"]

    def radius(self) -> Float[np.ndarray, " T"]:
        """Spectral radius of the loop of every sample, what is held left out.

        A held integral, z_i(k+1) = z_i(k), is a constant that acts on the others: they stay
        bounded under it for ever where they alone are stable.
        """
        M = np.asarray(self.M)
        held = np.all(M == np.eye(M.shape[1]), axis=2) & np.all(np.asarray(self.E) == 0, axis=2)
        return spectral_radius(np.where(held[:, :, None] | held[:, None], 0.0, M))


class Box(NamedTuple):
    """Bounds of what acts on a loop at every sample, |w_i(k)| <= size_i.

    >>> Box.of(0.02, 4e-7, inputs=2, measured=2).size.tolist()
    [0.02, 0.02, 4e-07, 4e-07]

    Attributes:
        force: on every control [control unit].
        noise: on every number of the measurement, in its own unit: a position [m], a speed [m/s].
            One number for all bounds both, which differ in size: give one for each there.
    """

    force: Float[np.ndarray, " p"]
    noise: Float[np.ndarray, " q"]

    @classmethod
    def of(
        cls,
        force: float | Sequence[float],
        noise: float | Sequence[float],
        inputs: int,
        measured: int,
    ) -> "Box":
        """Box with one number for all channels, or one for each.

        Raises:
            ValueError: a bound is negative or not finite, or their number is wrong.
        """
        return cls(_sizes("force", force, inputs), _sizes("noise", noise, measured))

    @property
    def size(self) -> Float[np.ndarray, " d"]:
        """All bounds in a row, those of the force first."""
        return np.concatenate([self.force, self.noise])


def _sizes(name: str, value: Any, count: int) -> np.ndarray:
    sizes = np.asarray(value, float)
    if sizes.ndim > 1 or (sizes.ndim == 1 and sizes.size != count):
        raise ValueError(f"{name}: needs one bound or {count}, received shape {sizes.shape}")
    if not np.all(np.isfinite(sizes) & (sizes >= 0)):
        raise ValueError(f"{name}: a bound needs to be finite and at least zero, received {value}")
    return np.broadcast_to(sizes, count).copy()


def disturbed_loop(plant: Plant, controller: Controller, reference: Reference) -> DisturbedLoop:
    """Matrices of the loop that `simulate` runs, limits of the control left out.

    Raises:
        NotAffine: plant or controller is not linear in state, memory and measurement.
        UnstableLoop: the loop of some sample, held for ever, is not stable.
        ValueError: as `simulate`.
    """
    _check_linear(plant, controller, reference)
    plant, controller = unlimited(plant), unlimited(controller)
    plan = prepared(controller, reference)
    loop = eqx.filter_jit(_loop_along)(plant, controller, plan, reference)
    # the loop of every sample, held for ever, has to be stable
    if not np.isfinite(np.asarray(loop.M)).all():
        raise UnstableLoop("the loop has no bound: its matrices are not finite")
    radius = loop.radius()
    worst = int(np.argmax(radius))
    if radius[worst] >= 1:
        raise UnstableLoop(
            f"the loop has no finite bound: spectral radius {radius[worst]:.6g} at sample {worst}"
        )
    return loop


def _check_linear(plant: Plant, controller: Controller, reference: Reference) -> None:
    """Raise unless both steps, without limits of the control, are affine; nothing is run."""
    check_run(plant, controller, reference)
    check_planless(controller)
    plant, controller = unlimited(plant), unlimited(controller)
    plan = eqx.filter_eval_shape(controller.prepare, reference)
    row = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), plan)
    state, memory = start_state(plant, reference), controller.initial_memory(reference)
    measurement = plant.measure(state)
    check_linear_controller(controller, row, memory, measurement)
    _, shape = jax.eval_shape(controller.step, memory, row, measurement)
    control = np.zeros(shape.shape, shape.dtype)

    def driven(_, moving, fixed):
        state, control = eqx.combine(moving, fixed)
        return plant.step(state, control), plant.output(state), plant.measure(state)

    _check(plant, driven, row, (state, control))


def check_planless(controller: Controller) -> None:
    """Raise NotAffine where a controller plans for limits, whether they are reached or not."""
    free = controller.without_planned_limits()
    if free is not controller and not eqx.tree_equal(*jax.device_get((controller, free))):
        raise NotAffine(
            f"{type(controller).__name__}: it plans for limits, or is linear near its surface alone"
        )


def check_linear_controller(
    controller: Controller, plan: Plan, memory: Memory, measurement: Any
) -> None:
    """Raise NotAffine unless the step is affine in memory and measurement; `plan` is one row."""

    def controlled(plan, moving, fixed):
        memory, measurement = eqx.combine(moving, fixed)
        return controller.step(memory, plan, measurement)

    _check(controller, controlled, plan, (memory, measurement))


def _check(part: Plant | Controller, step: Any, plan: Plan, inputs: Any) -> None:
    moving, fixed = eqx.partition(inputs, eqx.is_inexact_array)

    def floating(plan: Plan, moving: Any) -> Any:
        return eqx.filter(step(plan, moving, fixed), eqx.is_inexact_array)

    try:
        check_affine(floating, plan, moving)
    except NotAffine as error:
        raise NotAffine(f"{type(part).__name__}: {error}") from None


def _loop_along(
    plant: Plant, controller: Controller, plan: Plan, reference: Reference
) -> DisturbedLoop:
    """Matrices of a loop without limits along its run; traceable, nothing is checked."""
    run = follow(plant, controller, plan, reference)

    def at(step):
        plan_k, state, memory = step
        (A, B, H), (W, L, K, D) = frozen_loop(plant, controller, plan_k, state, memory)
        moving, fixed = eqx.partition(state, eqx.is_inexact_array)
        flat, shaped = ravel_pytree(moving)
        slope = jax.jacfwd(lambda row: plant.output(eqx.combine(shaped(row), fixed)))(flat)
        c, p = W.shape[0], B.shape[1]
        M = blocks([[A + B @ D @ H, B @ K], [L @ H, W]])
        E = blocks([[B, B @ D], [np.zeros((c, p), A.dtype), L]])
        C = blocks([[slope, np.zeros((slope.shape[0], c), A.dtype)]])
        return M, E, C, blocks([[D @ H, K]]), jnp.asarray(D)

    steps = jax.vmap(at)((plan, run.state, run.memory))
    return DisturbedLoop(*steps, run.output, run.control)
