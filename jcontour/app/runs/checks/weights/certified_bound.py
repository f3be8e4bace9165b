"""Certified bound of tuned weights: one number for all contours and plants that are tuned on."""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax

from jcontour.app.beside import Beside
from jcontour.app.files.results.certified_result import CertifiedBound
from jcontour.app.machines.disturbance_bounds import bounds_of, box_of
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.controller import Controller
from jcontour.guarantees.certificates import certificate_of
from jcontour.guarantees.disturbed_family import DisturbedFamily
from jcontour.guarantees.disturbed_loop import Box, check_linear, check_stable
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.simulation.evaluation import member, stack_plants


def certified_bound(
    run: TuningRun, controller: Controller, process: Beside
) -> Callable[[], CertifiedBound | None]:
    """Largest certified error over the training contours and the family, once it is asked for.

    None for a machine that is not linear.

    Args:
        run: of the tuning.
        controller: with the tuned weights.
        process: that computes it meanwhile.
    """
    machine, flags = run.machine.form(LinearMachine), run.flags
    if machine is None:
        return lambda: None
    bounds = bounds_of(machine, flags.force, flags.encoder_um)
    family = machine.exact_family(run.design.fed)
    box = box_of(family[0], bounds, machine, run.design.fed)
    references = jax.device_get(run.problem.references)
    samples = [job.steps for job in run.learned]
    largest = process.submit(
        largest_error, stack_plants(family), controller, box, references, samples
    )

    def bound() -> CertifiedBound:
        found = largest()
        if isinstance(found, str):
            return CertifiedBound(force=bounds.force, encoder=bounds.encoder, refused=found)
        error, contour, plant = found
        return CertifiedBound(
            force=bounds.force,
            encoder=bounds.encoder,
            error=error,
            contour=run.learned[contour].name,
            plant=machine.family_names[plant],
        )

    return bound


def largest_error(
    plants: Plant, controller: Controller, box: Box, references: Reference, samples: Sequence[int]
) -> tuple[float, int, int] | str:
    """Largest bound [m] with its contour and plant; why there is none where a loop has none.

    Args:
        controller: of the loops.
        plants: the family, stacked.
        box: bounds of what acts on them.
        references: of the contours, stacked; as long as the longest of them.
        samples: of every contour.
    """
    try:
        check_linear(member(plants, 0), controller, member(references, 0))
        family = DisturbedFamily(plants, box.force, box.noise, box.force)
        loops = jax.device_get(eqx.filter_jit(family.loops)(controller, references))
        bounds = []
        for c, steps in enumerate(samples):
            reference = member(references, c).first(steps)
            for p in range(loops.E.shape[1]):
                loop = jax.tree.map(lambda rows, c=c, p=p, steps=steps: rows[c, p, :steps], loops)
                check_stable(loop)
                one = certificate_of(loop, member(plants, p), controller, reference, box)
                bounds.append((one.largest, c, p))
    except ValueError as error:
        return str(error)
    return max(bounds, key=lambda bound: bound[0])
