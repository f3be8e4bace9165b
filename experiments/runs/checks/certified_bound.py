"""Certified bound of tuned weights: one number for all contours and plants that are tuned on."""

import equinox as eqx
import jax

from experiments.files.results.certified_result import CertifiedBound
from experiments.machines.disturbance_bounds import bounds_of, box_of
from experiments.machines.linear import LinearMachine
from experiments.runs.tuning import TuningRun
from jcontour.controller import Controller
from jcontour.guarantees.certificates import certificate_of
from jcontour.guarantees.disturbed_family import DisturbedFamily
from jcontour.guarantees.disturbed_loop import Box, check_linear, check_stable
from jcontour.plant import Plant
from jcontour.simulation.evaluation import member, stack_plants


def certified_bound(run: TuningRun, controller: Controller) -> CertifiedBound | None:
    """Largest certified error over the training contours and the family.

    None for a machine that is not linear.
    """
    machine, flags = run.machine, run.flags
    if not isinstance(machine, LinearMachine):
        return None
    bounds = bounds_of(machine, flags.force, flags.encoder_um)
    family = machine.exact_family(run.design.fed)
    box = box_of(family[0], bounds, machine, run.design.fed)
    try:
        found = _certified(run, controller, stack_plants(family), box)
    except ValueError as error:
        return CertifiedBound(force=bounds.force, encoder=bounds.encoder, refused=str(error))
    (c, p), largest = max(found.items(), key=lambda one: one[1])
    return CertifiedBound(
        force=bounds.force,
        encoder=bounds.encoder,
        error=largest,
        contour=run.learned[c].name,
        plant=machine.family_names[p],
    )


def _certified(
    run: TuningRun, controller: Controller, plants: Plant, box: Box
) -> dict[tuple[int, int], float]:
    """Bound [m] of every contour and plant.

    Raises:
        ValueError: a loop has no certificate.
    """
    references = jax.device_get(run.problem.references)
    check_linear(member(plants, 0), controller, member(references, 0))
    family = DisturbedFamily(plants, box.force, box.noise, box.force)
    loops = jax.device_get(eqx.filter_jit(family.loops)(controller, references))
    count, members = loops.E.shape[:2]
    bounds = {}
    for c in range(count):
        steps = run.learned[c].samples  # what is stacked is as long as the longest
        reference = member(references, c).first(steps)
        for p in range(members):
            loop = jax.tree.map(lambda rows, c=c, p=p, steps=steps: rows[c, p, :steps], loops)
            check_stable(loop)
            one = certificate_of(loop, member(plants, p), controller, reference, box)
            bounds[c, p] = one.largest
    return bounds
