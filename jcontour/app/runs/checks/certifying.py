"""Certificates of a loop on every contour and every plant of a linear machine.

Friction is one of the forces that are bounded: the plants have none of their own.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from jcontour.app.beside import Beside
from jcontour.app.files.results.bound_results import CertifiedBound, CertifiedRow
from jcontour.app.files.results.run_metrics import PeakPlace
from jcontour.app.jobs.job import Task
from jcontour.app.machines.disturbance_bounds import Bounds, bounds_of, box_of, linear_machine
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.runs.stored_loops import StoredLoop
from jcontour.app.runs.tuning.problem import TuningRun
from jcontour.bounds.attacks import Attack
from jcontour.bounds.certificates import Certificate, certificate, certificate_of
from jcontour.bounds.disturbed_family import DisturbedFamily
from jcontour.bounds.disturbed_loop import Box, check_linear, check_stable
from jcontour.bounds.gains.gain_cells import GainCell
from jcontour.bounds.gains.gain_certificates import gain_certificate
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.plants.actuation import Disturbed
from jcontour.plants.encoders import Quantised
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import member, stack_plants
from jcontour.simulation.metrics import contour_error, tracking_error


@dataclass(frozen=True)
class CertifiedRun:
    """One contour on one plant.

    Attributes:
        row: in short.
        reference: of the run.
        found: the certificate.
        attack: that reached most.
        reached: error under it (T,) [m].
    """

    row: CertifiedRow
    reference: Reference
    found: Certificate
    attack: Attack
    reached: np.ndarray


class Proven(NamedTuple):
    """Certificate of one contour on one plant.

    Attributes:
        name: of the plant.
        plant: without sensors that count.
        true: with whole counts.
    """

    job: Task
    name: str
    plant: Plant
    true: Plant
    reference: Reference
    found: Certificate


def certified_runs(loop: StoredLoop, bounds: Bounds, cells: int) -> Iterator[CertifiedRun]:
    """Certificates and attacks of all contours and plants, one after the other.

    Args:
        loop: of a linear machine.
        bounds: of what acts on it.
        cells: most cells of the gains between the members, see `gain_certificates`; zero for the
            members alone.

    Raises:
        ValueError: a loop has no certificate; contour and plant are named.
    """
    for proven in _of_members(loop, bounds):
        yield _attacked(loop.controller, proven)
    if cells > 0:
        for proven in _of_all_gains(loop, bounds, cells):
            yield _attacked(loop.controller, proven)


def _of_members(loop: StoredLoop, bounds: Bounds) -> Iterator[Proven]:
    """Certificates of all contours on every member of the family."""
    machine, fed = linear_machine(loop.machine).frictionless, loop.fed
    box = box_of(machine.nominal(fed), bounds, machine, fed)
    plants = zip(
        machine.family_names, machine.exact_family(fed), machine.true_family(fed), strict=True
    )
    for job, (name, plant, true) in product(loop.jobs, list(plants)):
        reference = job.reference(machine.model.dt, loop.controller.preview)
        with _named(job, name):
            found = certificate(plant, loop.controller, reference, box)
        yield Proven(job, name, plant, true, reference, found)


def _of_all_gains(loop: StoredLoop, bounds: Bounds, cells: int) -> Iterator[Proven]:
    """Certificates of all contours at every delay, each for all gains."""
    machine, fed = linear_machine(loop.machine).frictionless, loop.fed
    box, one = box_of(machine.nominal(fed), bounds, machine, fed), np.ones(machine.model.inputs)
    gains = GainCell((1 - machine.gain) * one, (1 + machine.gain) * one)
    for job, late in product(loop.jobs, range(machine.delay + 1)):
        reference = job.reference(machine.model.dt, loop.controller.preview)
        name = f"all gains, {late} late"
        with _named(job, name):
            plant = machine.exact_plant(one, late, fed)
            found = gain_certificate(plant, loop.controller, reference, box, gains, cells)
        worst = found.gains, late, fed
        attacked = machine.exact_plant(*worst), machine.true_plant(*worst)
        yield Proven(job, name, *attacked, reference, found.whole)


@contextmanager
def _named(job: Task, plant: str) -> Iterator[None]:
    """Name contour and plant where there is no certificate."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{job.name}, {plant}: {error}") from None


def _attacked(controller: Controller, proven: Proven) -> CertifiedRun:
    plant, reference, found = proven.plant, proven.reference, proven.found
    attacks = found.attacks()
    errors = [_error(attack.on(plant), controller, reference) for attack in attacks]
    most = int(np.argmax([_largest(error, found) for error in errors]))
    counted = None
    if isinstance(proven.true, Quantised):
        forced = Disturbed(proven.true, force=jax.device_put(attacks[most].force))
        counted = _largest(_error(forced, controller, reference), found)
    row = CertifiedRow(
        contour=proven.job.name,
        plant=proven.name,
        bound=found.largest,
        nominal=_largest(found.nominal, found),
        reached=_largest(errors[most], found),
        counted=counted,
        control=tuple(found.control.max(axis=0).tolist()),
        place=_place(proven),
    )
    return CertifiedRun(row, reference, found, attacks[most], errors[most])


def _error(plant: Plant, controller: Controller, reference: Reference) -> np.ndarray:
    """Error that counts, at every sample (T,) [m]."""
    run = simulate(plant, controller, reference)
    kind = tracking_error if reference.position.shape[1] == 1 else contour_error
    return np.linalg.norm(np.asarray(kind(run.output, reference)), axis=1)


def _largest(error: np.ndarray, found: Certificate) -> float:
    return float(np.max(error[found.scored]))


def _place(proven: Proven) -> PeakPlace:
    reference, found = proven.reference, proven.found
    return PeakPlace(
        plant=proven.name,
        error=found.largest,
        time=float(found.worst * reference.dt),
        position=tuple(np.asarray(reference.position)[found.worst].tolist()),
        line=proven.job.line_at(found.worst),
    )


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
