"""`jcontour check RUN --bound`: largest error that a stored loop can have, an attack near it."""

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from jcontour.app.files import run_folder
from jcontour.app.files.checks import named
from jcontour.app.files.netcdf import Variables, save_variables
from jcontour.app.files.results.loop_results import CertifiedResult, CertifiedRow
from jcontour.app.files.results.run_metrics import PeakPlace
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.verdict import LimitCheck, Verdict, kept_words
from jcontour.app.flags.loops import Check
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine import Fed, Machine
from jcontour.app.machines.uncertainty import FARTHEST, in_words
from jcontour.app.reports import tables
from jcontour.app.reports.figures.axes import DESIRED, START, TUNED, save_figure
from jcontour.app.reports.figures.loops import ErrorCurve, errors_figure
from jcontour.app.reports.progress import counted
from jcontour.app.reports.screen import Entry
from jcontour.app.reports.tables import digits, of_axes, peak_line, say, table_of
from jcontour.app.runs.contour_summary import loop_summary
from jcontour.app.runs.lifecycle import created, finished, words_of
from jcontour.app.runs.stored_loops import StoredLoop, stored_loop
from jcontour.bounds.certificates import Certificate, certificate
from jcontour.bounds.disturbed_loop import Box
from jcontour.bounds.peak_bounds import Attack
from jcontour.controller import Controller
from jcontour.motion.references import Reference
from jcontour.plant import Plant
from jcontour.plants.actuation import Disturbed
from jcontour.plants.encoders import Quantised
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import tracking_error

ATTACK = "attack.nc"

BOUNDS = (
    "--force and --encoder-um set these bounds. Not given, they are the control noise of the "
    "machine (5 % of its control limit where its file states none) or the friction of its file, "
    "and half a count. Such a default does not measure cutting, nor friction that is not in the "
    "file: give your own."
)


@dataclass(frozen=True)
class CertifiedRun:
    """One contour on one plant."""

    row: CertifiedRow  # in short
    reference: Reference  # of the run
    certificate: Certificate
    attack: Attack  # that reached most
    reached: np.ndarray  # error under it (T,) [m]


class Bounds(NamedTuple):
    """Bounds of the disturbances at every sample."""

    force: float  # on every control [control unit]
    encoder: float | tuple[float, ...]  # on every measured number, one or one for each [m]


def promised(machine: Machine) -> LinearMachine:
    """The machine, where it is linear; warns of a response that is unsure."""
    linear = machine.linear
    if linear is None:
        raise ValueError(
            f"plant: {machine.name} is not linear: what is proven is of machines with a linear "
            "model, as bridgeport, xy-table or a machine file"
        )
    if linear.response_uncertainty is not None:
        warnings.warn(
            f"{machine.name}: how far off its response may be (uncertainty.response) is not in "
            "what is promised: it holds for the model with its gains and delays",
            stacklevel=2,
        )
    return linear


def bounds_of(machine: LinearMachine, force: float | None, encoder_um: float | None) -> Bounds:
    """Bounds as given; else friction, without it control noise, and what encoders err.

    Friction is that of any member of the family: it acts behind the input gain, so that the force
    at the control is F (1 + 0.1) / (1 - g) with the relative uncertainty g of the gains. Encoders
    err by half a count, and three deviations of their noise.
    """
    for name, value in (("force", force), ("encoder-um", encoder_um)):
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise ValueError(f"{name}: a bound needs to be finite and at least zero, is {value}")
    half = machine.resolution / 2 + FARTHEST * machine.encoder_noise
    rounding = tuple(half.tolist()) if isinstance(half, np.ndarray) else half
    encoder = rounding if encoder_um is None else 1e-6 * encoder_um
    if np.any(np.asarray(encoder) < half * (1 - 1e-9)):
        why = "rounding alone errs by half a count"
        if np.any(machine.encoder_noise):
            why = f"half a count and {FARTHEST:g} deviations of noise"
        raise ValueError(f"encoder-um: {why}, {in_words(half)}, received {encoder_um}")
    if force is None and machine.friction is None:
        warnings.warn(
            f"{machine.name}: its dry friction is not known (friction is null), and not in what is "
            "promised: give --force, or record long moves and identify again",
            stacklevel=2,
        )
    most = 1 + float(np.max(machine.friction_known_to))
    friction = machine.largest_friction * most / (1 - machine.uncertainty.gain)
    return Bounds((friction or machine.control_noise) if force is None else force, encoder)


def box_of(plant: Plant, bounds: Bounds, machine: LinearMachine, fed: Fed) -> Box:
    """Box of a loop on a plant of the machine; a state that is measured as it is has no error."""
    none = jnp.zeros(len(machine.axes))
    measured = jax.eval_shape(lambda: plant.measure(plant.initial_state(none, none)))
    count = sum(np.prod(leaf.shape, dtype=int) for leaf in jax.tree.leaves(measured))
    noise = bounds.encoder if fed == "outputs" else 0.0
    return Box.of(bounds.force, noise, machine.model.inputs, int(count))


def command(flags: Check) -> int:
    """The whole command: prove, attack, print, exit code."""
    loop = stored_loop(flags.run)
    machine = promised(loop.machine)
    bounds = bounds_of(machine, flags.force, flags.encoder_um)
    count = len(loop.jobs) * len(machine.family_names)
    rows, worst = [], None
    with counted(tables.console_of(stderr=True, quiet=flags.json), count, "proofs") as done:
        for one in certified_runs(loop, machine, bounds):
            rows.append(one.row)
            done(1)
            if worst is None or one.row.bound > worst.row.bound:
                worst = one
    assert worst is not None
    limit = machine.limits.control
    limits = None if limit is None else tuple(np.asarray(limit, float).tolist())
    result = CertifiedResult(
        certified=str(flags.run),
        **loop_summary(machine, loop.name),
        force=bounds.force,
        encoder=bounds.encoder,
        control_limit=limits,
        rows=rows,
        verdict=verdict_on(rows, limits, machine.control_unit),
    )
    folder = created(flags, "check")
    _save(worst, loop, folder)
    curves = [
        ErrorCurve("bound, proven", worst.certificate.bound, START),
        ErrorCurve("reached under attack", worst.reached, TUNED),
        ErrorCurve("undisturbed", worst.certificate.nominal, DESIRED),
    ]
    title = f"{worst.row.contour}, {worst.row.plant}"
    figure = errors_figure(title, machine.error, worst.reference, curves)
    save_figure(figure, folder / "certificate.png")
    write_result(folder, result)
    row = result.worst
    force = f"{digits(result.force)} {result.machine.control_unit}"
    off = f"up to {of_axes(result.encoder, result.machine.axes)}"
    shares = f"an attack reaches {100 * row.reached / row.bound:.0f} % of it"
    answer = [
        Entry("Bound", f"{digits(1e6 * row.bound)} um, {row.contour}, {row.plant}; {shares}"),
        Entry("Worst", peak_line(row.place, result.error, result.machine.axes)),
        Entry(
            "Proven", f"for every force of up to {force} on each control and encoder error of {off}"
        ),
        Entry("Assumed", "--force and --encoder-um say what acts on your machine"),
    ]
    if result.verdict.usable:
        answer.append(Entry("Next", f"jcontour export{words_of([str(flags.run)])}"))
    else:
        answer.append(Entry("Advice", "tune again with a lower --max-peak-control"))
    return finished(folder, result, flags, show_certified, answer, result.verdict)


def verdict_on(
    rows: Sequence[CertifiedRow], limits: tuple[float, ...] | None, unit: str
) -> Verdict:
    """Verdict on the controls that are proven; the proof holds where none meets its limit.

    Args:
        rows: one per contour and plant.
        limits: of each control; None where the machine states none.
        unit: of the controls.
    """
    checks = []
    for k, allowed in enumerate(limits or ()):
        worst = max(rows, key=lambda row, k=k: row.control[k])
        checks.append(
            LimitCheck(
                name=f"control of input {k + 1}",
                value=worst.control[k],
                allowed=allowed,
                unit=unit,
                member=f"{worst.contour}, {worst.plant}",
            )
        )
    helps = ["the proof takes no account of a control at its limit: it does not hold there"]
    return Verdict.of(checks, limit_remedies=helps, passed=kept_words(checks))


def _save(one: CertifiedRun, loop: StoredLoop, folder: Path) -> None:
    """The attack of the largest bound, for a replay, and what it was made for."""
    machine, certificate = loop.machine, one.certificate
    time = one.reference.dt * np.arange(certificate.bound.size)
    data: Variables = {
        "time": (("time",), time, {"units": "s"}),
        "force": (("time", "input"), one.attack.force, {"units": machine.control_unit}),
        "noise": (("time", "sensor"), one.attack.noise, {"units": "m"}),
        "bound": (("time",), certificate.bound, {"units": "m"}),
        "reached": (("time",), one.reached, {"units": "m"}),
        "nominal": (("time",), certificate.nominal, {"units": "m"}),
        "scored": (("time",), certificate.scored.astype("i1"), {"long_name": "1 where it counts"}),
    }
    title = {
        "title": "jcontour check: attack on the largest bound",
        "contour": one.row.contour,
        "plant": one.row.plant,
        "attacked_sample": certificate.worst,
        **run_folder.versions(),
    }
    save_variables(data, title, folder / ATTACK)


def show_certified(result: CertifiedResult, console: Console) -> None:
    """The table, and what it is proven for."""
    title = f"Largest {result.error} error of {result.controller} on {result.machine.name}"
    columns: dict[str, Callable[[CertifiedRow], str | float | None]] = {
        "contour": lambda row: row.contour,
        "plant": lambda row: row.plant,
        "largest error\nproven um": lambda row: 1e6 * row.bound,
        "reached\nunder attack um": lambda row: 1e6 * row.reached,
        "reached by force\nwith counts um": lambda row: row.counted and 1e6 * row.counted,
        "undisturbed\num": lambda row: 1e6 * row.nominal,
        "largest\ncontrols": lambda row: ", ".join(map(digits, row.control)),
    }
    console.print(table_of(title, result.rows, columns, text_columns=2))
    say(
        console,
        "Proven for each plant of the table, started on the path. Not for plants between them.",
        BOUNDS,
        f"The attack, the bound and both errors at every sample: {ATTACK}",
    )


def certified_runs(
    loop: StoredLoop, machine: LinearMachine, bounds: Bounds
) -> Iterator[CertifiedRun]:
    """Certificates and attacks of all contours on every member of the family, one after the other.

    Args:
        loop: that is certified.
        machine: its machine.
        bounds: of what acts on it.
    """
    machine, fed, controller = machine.frictionless, loop.fed, loop.controller
    box = box_of(machine.nominal(fed), bounds, machine, fed)
    plants = zip(
        machine.family_names, machine.exact_family(fed), machine.true_family(fed), strict=True
    )
    for job, (name, plant, counting) in product(loop.jobs, list(plants)):
        reference = job.reference(machine.model.dt, controller.preview)
        with named(f"{job.name}, {name}"):
            bound = certificate(plant, controller, reference, box)
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
    """Error that counts, at every sample (T,) [m]; from the whole path, as what is proven."""
    run = simulate(plant, controller, reference)
    if reference.position.shape[1] == 1:
        return np.linalg.norm(np.asarray(tracking_error(run.output, reference)), axis=1)
    path, arc = reference.contour, reference.arc[: reference.steps]
    away = run.output - path.position(path.nearest(run.output, arc, path.length))
    return np.linalg.norm(np.asarray(away), axis=1)


def _largest(error: np.ndarray, bound: Certificate) -> float:
    return float(np.max(error[bound.scored]))
