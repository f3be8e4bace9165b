"""Is the loop stable, and by how much: frozen loops along a path, and how much gain error and delay they bear.

A frozen loop is the closed loop with the plan of one step held for ever: z(k+1) = M z(k) + const, z the state of the plant and
the memory of the controller. McNab & Tsao, Theorem 1 and eq. 23, where M = A - B K; here M is the Jacobian of one step, so that
observers, delays and any other controller or plant are covered by the same words. Host side.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Bool, Float

from jcontour.contours import line
from jcontour.controller import Controller, Plan
from jcontour.linear import LinearPlant, spectral_radius, with_input_gains
from jcontour.plant import Plant
from jcontour.plants.wrappers import Delayed, Encoders
from jcontour.references import Reference, along
from jcontour.simulation import check_run, prepared, start_state

GAIN_SEARCH = 20.0  # factor up and down beyond which a gain margin counts as unlimited
DELAY_SEARCH = 10  # samples beyond which a delay margin is not followed
GAIN_RESOLUTION = 1e-3  # relative width to which a gain margin is bisected
PROBED_LOOPS = 48  # frozen loops that guide a search; all of them confirm it


class Margins(NamedTuple):
    """What every frozen loop along a path survives.

    Attributes:
        spectral_radius: the largest of all frozen loops; the loop is stable below 1.
        gain: (p, 2) lower and upper factor on each control, alone, within which every loop stays stable.
        delay: most whole samples of extra control delay; -1 when a loop is unstable without any.
    """

    spectral_radius: float
    gain: np.ndarray
    delay: int


def frozen_spectral_radius(controller: Controller, direction: Float[ArrayLike, " m"], plant: Plant | None = None) -> float:
    """Spectral radius of the loop along a straight line: Theorem 1's check.

    Args:
        controller: any controller; its gains on the line must not depend on the speed.
        direction: (m,) of any length.
        plant: the machine; the controller's own model when not given, behind encoders where an observer is fed positions.

    Raises:
        ValueError: the direction is zero or not finite, or the controller has no model and no plant is given.
    """
    plant = _own_model(controller) if plant is None else plant
    along_path = np.asarray(direction, float)
    length = np.linalg.norm(along_path)
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"direction: needs a finite vector of non-zero length, received {direction}")
    contour = line(np.zeros(along_path.size), 1e-3 * along_path / length)  # [m] any length: the reference goes on straight
    reference = along(contour, [0.0, 1e-3], plant.dt, controller.preview, at_rest=False)
    return float(frozen_spectral_radii(plant, controller, reference)[0])


def frozen_spectral_radii(plant: Plant, controller: Controller, reference: Reference) -> Float[np.ndarray, " T"]:
    """Spectral radius of the frozen loop of every step along a reference.

    Raises:
        ValueError: as `simulate`.
    """
    check_run(plant, controller, reference)
    return spectral_radius(_frozen_loops(plant, controller, prepared(controller, reference), reference))


def margins(plant: LinearPlant, controller: Controller, reference: Reference, measured=lambda plant: plant) -> Margins:
    """Gain and delay margins of every frozen loop along a reference.

    Args:
        plant: the machine whose inputs are perturbed.
        controller: the controller under test.
        reference: where the gains are frozen; every scored step counts.
        measured: wraps the perturbed plant in its sensors, for example `Encoders` (a smooth twin: quantisers have no slope).

    Raises:
        ValueError: as `simulate`.
    """
    check_run(plant, controller, reference)
    plan = _scored_rows(prepared(controller, reference), reference.mask[: reference.steps])

    def radii(rows: Plan, gains=1.0):
        return spectral_radius(_frozen_loops(measured(with_input_gains(plant, gains)), controller, rows, reference))

    def late_radii(delay: int):
        late = Delayed(plant, jnp.asarray(delay), DELAY_SEARCH, plant.inputs)  # of one depth: compiled once
        return spectral_radius(_frozen_loops(measured(late), controller, plan, reference))

    nominal = radii(plan)
    if nominal.max() >= 1:
        return Margins(float(nominal.max()), np.ones((plant.inputs, 2)), -1)
    gain = np.array([[_gain_limit(radii, plan, i, plant.inputs, factor) for factor in (1 / 1.05, 1.05)] for i in range(plant.inputs)])
    delay = next((d for d in range(DELAY_SEARCH) if late_radii(d + 1).max() >= 1), DELAY_SEARCH)
    return Margins(float(nominal.max()), gain, delay)


def _own_model(controller: Controller) -> Plant:
    model = getattr(controller, "model", None)
    if model is None:
        raise ValueError("plant: this controller has no model of its own; give the plant")
    return Encoders(model) if hasattr(controller, "controller") else model  # an observer wraps a controller


@eqx.filter_jit
def _frozen_loops(plant: Plant, controller: Controller, plan: Plan, reference: Reference) -> Float[Array, "T N N"]:
    loop = (start_state(plant, reference), controller.initial_memory(reference))
    moving, fixed = eqx.partition(loop, eqx.is_inexact_array)
    flat, unravel = ravel_pytree(moving)

    def one_step(z, plan_k):
        state, memory = eqx.combine(unravel(z), fixed)
        memory, control = controller.step(memory, plan_k, plant.measure(state))
        after = eqx.filter((plant.step(state, control), memory), eqx.is_inexact_array)
        return ravel_pytree(after)[0]

    return jax.vmap(lambda row: jax.jacfwd(one_step)(flat, row))(plan)


def _scored_rows(plan: Plan, scored: Bool[Array, " T"]) -> Plan:
    rows = np.flatnonzero(np.asarray(scored))
    return jax.tree.map(lambda leaf: leaf[rows], plan)


def _gain_limit(radii, plan: Plan, index: int, inputs: int, factor: float) -> float:
    """The factor on one control, going from 1 in steps of `factor`, at which the first frozen loop loses stability."""
    steps = jax.tree.leaves(plan)[0].shape[0]
    rows = np.unique(np.linspace(0, steps - 1, min(PROBED_LOOPS, steps)).astype(int))

    def unstable(gain: float, rows) -> np.ndarray:
        gains = np.ones(inputs)
        gains[index] = gain
        return radii(jax.tree.map(lambda leaf: leaf[rows], plan), gains) >= 1

    while True:
        inside = _last_stable(lambda gain, rows=rows: not unstable(gain, rows).any(), factor)
        lost = np.flatnonzero(unstable(inside, np.arange(steps)))
        if lost.size == 0:
            return inside
        rows = np.union1d(rows, lost[:: max(1, lost.size // PROBED_LOOPS)])


def _last_stable(stable, factor: float) -> float:
    inside = 1.0
    while stable(inside * factor):
        inside *= factor
        if not 1 / GAIN_SEARCH < inside < GAIN_SEARCH:
            return inside
    outside = inside * factor
    while abs(outside / inside - 1) > GAIN_RESOLUTION:
        middle = np.sqrt(inside * outside)
        inside, outside = (middle, outside) if stable(middle) else (inside, middle)
    return inside
