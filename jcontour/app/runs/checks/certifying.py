"""Certificates of a loop on every contour and every plant of a linear machine.

Friction is one of the forces that are bounded: the plants have none of their own.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import jax
import numpy as np

from jcontour.app.files.results.loop_results import CertifiedRow
from jcontour.app.files.results.run_metrics import PeakPlace
from jcontour.app.machines.linear import Bounds, as_linear, box_of
from jcontour.app.runs.stored_loops import StoredLoop
from jcontour.bounds.certificates import Certificate, certificate
from jcontour.bounds.peak_bounds import Attack
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.plants.actuation import Disturbed
from jcontour.plants.encoders import Quantised
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import contour_error, tracking_error


@dataclass(frozen=True)
class CertifiedRun:
    """One contour on one plant."""

    row: CertifiedRow  # in short
    reference: Reference  # of the run
    certificate: Certificate
    attack: Attack  # that reached most
    reached: np.ndarray  # error under it (T,) [m]


def certified_runs(loop: StoredLoop, bounds: Bounds) -> Iterator[CertifiedRun]:
    """Certificates and attacks of all contours on every member of the family, one after the other.

    Args:
        loop: of a linear machine.
        bounds: of what acts on it.

    Raises:
        ValueError: a loop has no certificate; contour and plant are named.
    """
    machine, fed, controller = as_linear(loop.machine).frictionless, loop.fed, loop.controller
    box = box_of(machine.nominal(fed), bounds, machine, fed)
    plants = zip(
        machine.family_names, machine.exact_family(fed), machine.true_family(fed), strict=True
    )
    for job, (name, plant, counting) in product(loop.jobs, list(plants)):
        reference = job.reference(machine.model.dt, controller.preview)
        try:
            bound = certificate(plant, controller, reference, box)
        except ValueError as error:
            raise ValueError(f"{job.name}, {name}: {error}") from None
        attacks = bound.attacks()
        errors = [_error(attack.on(plant), controller, reference) for attack in attacks]
        most = int(np.argmax([_largest(error, bound) for error in errors]))
        counted = None
        if isinstance(counting, Quantised):
            forced = Disturbed(counting, force=jax.device_put(attacks[most].force))
            counted = _largest(_error(forced, controller, reference), bound)
        row = CertifiedRow(
            contour=job.name,
            plant=name,
            bound=bound.largest,
            nominal=_largest(bound.nominal, bound),
            reached=_largest(errors[most], bound),
            counted=counted,
            control=tuple(bound.control.max(axis=0).tolist()),
            place=PeakPlace(
                plant=name,
                error=bound.largest,
                time=float(bound.worst * reference.dt),
                position=tuple(np.asarray(reference.position)[bound.worst].tolist()),
                line=job.line_at(bound.worst),
            ),
        )
        yield CertifiedRun(row, reference, bound, attacks[most], errors[most])


def _error(plant: Plant, controller: Controller, reference: Reference) -> np.ndarray:
    """Error that counts, at every sample (T,) [m]."""
    run = simulate(plant, controller, reference)
    kind = tracking_error if reference.position.shape[1] == 1 else contour_error
    return np.linalg.norm(np.asarray(kind(run.output, reference)), axis=1)


def _largest(error: np.ndarray, bound: Certificate) -> float:
    return float(np.max(error[bound.scored]))
