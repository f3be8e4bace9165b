"""Derivative of a certificate: that of one run under the attack, held fixed (envelope theorem).

    d/dtheta max_k sup_w |e(k)| = d/dtheta |e(k*)| under w*,   k* and w* as found at theta
Where one sample and one attack are worst this is the gradient. Where several are, it is an element
of the generalised gradient.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.controller import Controller
from jcontour.guarantees.attacks import Attack, worst_attack
from jcontour.guarantees.disturbed_loop import Box, disturbed_loop
from jcontour.guarantees.peak_bounds import peak_bounds
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import projected_error


class WorstCase(NamedTuple):
    """Largest projected error of all scored samples, over a box.

    Attributes:
        bound: |e(k*)| [m].
        sample: k*.
        attack: w*.
    """

    bound: float
    sample: int
    attack: Attack


def worst_projected_error(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    box: Box,
    window: tuple[int, int] | None = None,
) -> WorstCase:
    """Largest |n' (y - y_d)| in the plane, exact, and the attack that reaches it.

    Args:
        plant: linear, without sensors that count.
        controller: linear in memory and measurement.
        reference: two axes; its scored samples count.
        box: of force and error of the measurement.
        window: samples a..b-1 that count; all when not given.

    Raises:
        ValueError: as `certificate`, or the reference has not two axes, or no sample counts.
    """
    if reference.position.shape[1] != 2:
        raise ValueError("reference: a normal needs two axes")
    loop, T = disturbed_loop(plant, controller, reference), reference.steps
    tangent = np.asarray(reference.tangent)[:T]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    rows = np.einsum("tm,tmn->tn", normal, loop.C)
    off = np.asarray(loop.output) - np.asarray(reference.position)[:T]
    error = np.sum(normal * off, axis=1)
    found = np.abs(error) + peak_bounds(loop, rows[:, None], box.size).bound[:, 0]
    first, last = (0, T) if window is None else window
    counts = np.asarray(reference.mask)[:T] & (np.arange(T) >= first) & (np.arange(T) < last)
    if not counts.any():
        raise ValueError("window: no scored sample is left")
    worst = int(np.argmax(np.where(counts, found, -np.inf)))
    attack = worst_attack(loop, rows[worst], worst, box, float(error[worst]))
    return WorstCase(float(found[worst]), worst, attack)


def attacked_error(
    plant: Plant, controller: Controller, reference: Reference, worst: WorstCase
) -> Float[Array, ""]:
    """Projected error at the worst sample under the worst attack [m]; traceable.

    Its value is the bound, its derivative that of the bound.
    """
    run = simulate(worst.attack.on(plant), controller, reference)
    error = projected_error(run.output, reference)[worst.sample]
    return jnp.sqrt(jnp.sum(error**2))
