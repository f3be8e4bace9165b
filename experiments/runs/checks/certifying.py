"""Certificates of a stored loop on every contour and every plant of a linear machine."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np

from experiments.files.results.certified_result import CertifiedRow
from experiments.files.results.run_metrics import PeakPlace
from experiments.jobs.job import Task
from experiments.machines.disturbance_bounds import Bounds, box_of, linear_machine
from experiments.runs.checks.stored_loops import StoredLoop
from jcontour.controller import Controller
from jcontour.guarantees.attacks import Attack
from jcontour.guarantees.certificates import Certificate, certificate
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.plants.wrappers.encoders import Quantised
from jcontour.simulation.closed_loop import simulate
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
    """

    job: Task
    name: str
    plant: Plant
    reference: Reference
    found: Certificate


def certificates_of(loop: StoredLoop, bounds: Bounds) -> Iterator[Proven]:
    """Certificates of all contours and plants, one after the other.

    Raises:
        ValueError: a loop has no certificate; contour and plant are named.
    """
    machine = linear_machine(loop.machine)
    plants = dict(zip(machine.family_names, machine.exact_family(loop.fed), strict=True))
    box = box_of(next(iter(plants.values())), bounds, machine, loop.fed)
    for job in loop.jobs:
        reference = job.reference(machine.model.dt, loop.controller.preview)
        for name, plant in plants.items():
            try:
                found = certificate(plant, loop.controller, reference, box)
            except ValueError as error:
                raise ValueError(f"{job.name}, {name}: {error}") from None
            yield Proven(job, name, plant, reference, found)


def certified_runs(loop: StoredLoop, bounds: Bounds) -> Iterator[CertifiedRun]:
    """Certificates and attacks of all contours and plants, one after the other.

    Raises:
        ValueError: as `certificates_of`.
    """
    machine = linear_machine(loop.machine)
    true = dict(zip(machine.family_names, machine.true_family(loop.fed), strict=True))
    for proven in certificates_of(loop, bounds):
        yield _attacked(loop.controller, proven, true[proven.name])


def _attacked(controller: Controller, proven: Proven, true_plant: Plant) -> CertifiedRun:
    plant, reference, found = proven.plant, proven.reference, proven.found
    attacks = found.attacks()
    errors = [_error(attack.on(plant), controller, reference) for attack in attacks]
    most = int(np.argmax([_largest(error, found) for error in errors]))
    counted = None
    if isinstance(true_plant, Quantised):
        forced = Disturbed(true_plant, force=jax.device_put(attacks[most].force))
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
