"""Certificates of a stored loop on every contour and every plant of a linear machine."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np

from experiments.files.certified_result import CertifiedRow
from experiments.files.run_metrics import PeakPlace
from experiments.jobs.job import Task
from experiments.machines.linear import LinearMachine
from experiments.machines.machine import Machine
from experiments.runs.checks.stored_loops import StoredLoop
from jcontour.controller import Controller
from jcontour.guarantees.attacks import Attack
from jcontour.guarantees.certificates import Certificate, certificate
from jcontour.guarantees.disturbed_loop import Box
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.plants.wrappers.disturbances import Disturbed
from jcontour.plants.wrappers.encoders import Quantised
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import contour_error, tracking_error


class Bounds(NamedTuple):
    """Bounds of the disturbances at every sample.

    Attributes:
        force: on every control [control unit].
        encoder: on every measured number [m].
    """

    force: float
    encoder: float


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


def linear_machine(machine: Machine) -> LinearMachine:
    """The machine, where it is linear.

    Raises:
        ValueError: it is not.
    """
    if not isinstance(machine, LinearMachine):
        raise ValueError(
            f"certify: {machine.name} is not linear: certificates are of machines with a linear "
            "model, as bridgeport, xy-table or a machine file"
        )
    return machine


def bounds_of(machine: LinearMachine, force: float | None, encoder_um: float | None) -> Bounds:
    """Bounds as given; else the machine's control noise, and half a count.

    Raises:
        ValueError: a bound is negative, or the encoder's error smaller than half a count.
    """
    for name, value in (("force", force), ("encoder-um", encoder_um)):
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise ValueError(f"{name}: a bound needs to be finite and at least zero, is {value}")
    half = machine.resolution / 2
    encoder = half if encoder_um is None else 1e-6 * encoder_um
    if encoder < half * (1 - 1e-9):
        raise ValueError(
            f"encoder-um: rounding alone errs by half a count, {1e6 * half:g} um, "
            f"received {encoder_um}"
        )
    return Bounds(machine.control_noise if force is None else force, encoder)


def certified_runs(loop: StoredLoop, bounds: Bounds) -> Iterator[CertifiedRun]:
    """Certificates and attacks of all contours and plants, one after the other.

    Raises:
        ValueError: a loop has no certificate; contour and plant are named.
    """
    machine = linear_machine(loop.machine)
    plants = dict(zip(machine.family_names, machine.true_family(loop.fed), strict=True))
    for job in loop.jobs:
        reference = job.reference(machine.model.dt, loop.controller.preview)
        for name, plant in plants.items():
            try:
                yield _certified(loop, plant, reference, bounds, (job, name))
            except ValueError as error:
                raise ValueError(f"{job.name}, {name}: {error}") from None


def _certified(
    loop: StoredLoop, true_plant: Plant, reference: Reference, bounds: Bounds, of: tuple[Task, str]
) -> CertifiedRun:
    controller, inputs = loop.controller, loop.machine.model.inputs
    counting = isinstance(true_plant, Quantised)
    plant = true_plant.plant if counting else true_plant
    box = _box(plant, reference, bounds, inputs, counting)
    found = certificate(plant, controller, reference, box)
    attacks = found.attacks()
    errors = [_error(attack.on(plant), controller, reference) for attack in attacks]
    most = int(np.argmax([_largest(error, found) for error in errors]))
    counted = None
    if counting:
        forced = Disturbed(true_plant, force=jax.device_put(attacks[most].force))
        counted = _largest(_error(forced, controller, reference), found)
    job, name = of
    row = CertifiedRow(
        contour=job.name,
        plant=name,
        bound=found.largest,
        nominal=_largest(found.nominal, found),
        reached=_largest(errors[most], found),
        counted=counted,
        control=tuple(found.control.max(axis=0).tolist()),
        place=_place(found, reference, of),
    )
    return CertifiedRun(row, reference, found, attacks[most], errors[most])


def _box(plant: Plant, reference: Reference, bounds: Bounds, inputs: int, counting: bool) -> Box:
    """Box of the loop; a state that is measured as it is has no error."""
    state = plant.initial_state(reference.position[0], reference.start_increment)
    measured = sum(np.size(leaf) for leaf in jax.tree.leaves(plant.measure(state)))
    return Box.of(bounds.force, bounds.encoder if counting else 0.0, inputs, measured)


def _error(plant: Plant, controller: Controller, reference: Reference) -> np.ndarray:
    """Error that counts, at every sample (T,) [m]."""
    run = simulate(plant, controller, reference)
    kind = tracking_error if reference.position.shape[1] == 1 else contour_error
    return np.linalg.norm(np.asarray(kind(run.output, reference)), axis=1)


def _largest(error: np.ndarray, found: Certificate) -> float:
    return float(np.max(error[found.scored]))


def _place(found: Certificate, reference: Reference, of: tuple[Task, str]) -> PeakPlace:
    job, name = of
    return PeakPlace(
        plant=name,
        error=found.largest,
        time=float(found.worst * reference.dt),
        position=tuple(np.asarray(reference.position)[found.worst].tolist()),
        line=job.line_at(found.worst),
    )
