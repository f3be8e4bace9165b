"""`jcontour export RUN`: the controller of a run as a law that streams, checked against the run."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float
from rich.console import Console

from jcontour.app.files import run_folder
from jcontour.app.files.results.loop_results import ExportedResult
from jcontour.app.files.results.stored import read_result, write_result
from jcontour.app.files.results.tuned_result import TunedResult
from jcontour.app.flags.loops import Export
from jcontour.app.jobs.job import Task
from jcontour.app.machines.uncertainty import in_words
from jcontour.app.plain_numbers import feed_words
from jcontour.app.reports import tables
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.checks.exported_code import compiled_checks, replayed
from jcontour.app.runs.lifecycle import created, finished
from jcontour.app.runs.stored_loops import StoredLoop, stored_loop
from jcontour.bounds.affine import NotAffine
from jcontour.controllers.wrappers.adapters import BacklashCompensation
from jcontour.export.code_text import heading
from jcontour.export.linuxcnc import linuxcnc_files, stock_pids
from jcontour.export.rendering import Code
from jcontour.export.safe_limits import SPEED_UP, SafeLimits, Stated, safe_limits
from jcontour.export.streaming_law import StreamingLaw, streaming_law
from jcontour.motion.references import Reference
from jcontour.sensors import row
from jcontour.simulation.closed_loop import simulate

ALIKE = 1e-8  # of the largest control: sums in another order differ by less, a limit by more
ROUNDED = 1e-3  # of the largest control: rounding that gives a warning
LOOKED_AT = 400  # samples on which the Python code is run: a millisecond or two each
SMALLEST = 1e-7  # [m] of a count, where a machine states none
LOOSE = (
    "the controller's own limits act on its memory, against windup, in a way that this code leaves "
    "out: do not let the control reach its limit"
)


@dataclass(frozen=True)
class Recorded:
    """A run of the controller on the nominal machine, with friction and counts."""

    name: str
    reference: Reference
    y: Float[np.ndarray, "T q"]
    u: Float[np.ndarray, "T p"]


def command(flags: Export) -> int:
    """The whole command: write, check, print, exit code."""
    result, folder = run(flags)
    then = "compile law.c into the drive, and check.c beside it once."
    if "law.c" not in result.files:
        then = "python law.py in the run folder replays the run."
    if "law.py" not in result.files and "law.c" not in result.files:
        then = "load law.st, and hand it the next reference points every sample."
    if flags.linuxcnc is not None:
        then = f"{flags.linuxcnc / 'README.md'} says how to load it."
    off = f"within {result.difference:.1e} {result.control_unit} of `simulate` on {result.contour}"
    compilers = ", ".join(one.compiler.split()[0] for one in result.compiled)
    sizes = []
    if result.compiled:
        one = max(result.compiled, key=lambda one: one.nanoseconds)
        time = f"{1e-3 * one.nanoseconds:.2g} us a sample, 99.9 % within {1e-3 * one.slow:.2g} us"
        words = f"{time}; code {one.code_bytes} bytes, memory {one.memory_bytes}"
        sizes.append(Entry("Size", words))
    answer = [
        Entry("Code", f"{result.controller} on {result.machine}, {result.preview} samples ahead"),
        Entry("Files", ", ".join(result.files)),
        Entry("Checked", f"{off}{'; ' if compilers else ''}{compilers}"),
        *sizes,
        *(Entry("Limits", line) for line in result.limits),
        *(Entry("Warning", line) for line in result.warnings),
        Entry("To load", then),
    ]
    return finished(folder, result, flags, show_exported, answer)


def run(flags: Export) -> tuple[ExportedResult, Path]:
    """Write the code of a stored run's controller; the result and the run folder."""
    loop = stored_loop(flags.run)
    named = {job.name: job for job in loop.jobs}
    along = loop.jobs[0].name if flags.along is None else flags.along
    if along not in named:
        raise ValueError(f"along: the run has {', '.join(named)}; received {along!r}")
    code, recorded = exported_code(loop, named[along], flags.single)
    law, unit = code.law, loop.machine.control_unit
    margins, warnings = _margins(flags.run, loop, law)
    limits = limit_lines(code.limits, loop)
    machine, version = loop.machine, run_folder.version_of("jcontour") or "unknown"
    seen = "positions" if loop.fed == "outputs" else "the state"
    notes = [
        f"{loop.name} on {machine.name}, written by jcontour {version} from {flags.run.name}",
        f"Axes: {', '.join(machine.axes)}. Measured: {seen} as `simulate` does, SI units.",
        f"Control: {unit}.",
        f"Family: {'; '.join(machine.family_names)}.",
        *limits,
        margins,
        *warnings,
    ]
    code = Code(law, code.limits, notes, unit, code.precision)
    increment = [repr(float(one)) for one in np.asarray(recorded.reference.start_increment)]
    python = code.text("law.py.j2", increment=increment)
    difference = _difference(python, recorded, loop.name)
    texts = {}
    if flags.c or not (flags.st or flags.python):
        texts["law.h"] = code.text("law.h.j2"), "what a call takes and gives, sizes, units"
        texts["law.c"] = code.text("law.c.j2"), "the law: law_init and law_step"
        texts["check.c"] = code.text("check.c.j2", increment=increment), "replays the run"
    if flags.st:
        texts["law.st"] = code.text("law.st.j2"), "the law as a function block"
    if flags.python:
        texts["law.py"] = python, "the law in Python; it replays the run when it is run"
    texts["check.csv"] = _check_file(recorded, unit), "the run: reference, measurements, controls"
    components = {}
    if flags.linuxcnc is not None:
        if flags.linuxcnc.exists():
            raise ValueError(f"linuxcnc: {flags.linuxcnc} is there already; name a new folder")
        components = linuxcnc_components(loop, code)
    folder = created(flags, "export")
    for name, (text, _) in texts.items():
        run_folder.write(folder / name, lambda path, text=text: path.write_text(text))
    if flags.linuxcnc is not None:
        flags.linuxcnc.mkdir(parents=True)
        for name, text in components.items():
            (flags.linuxcnc / name).write_text(text)
    compiled = compiled_checks(folder) if "law.c" in texts else []
    largest = float(np.abs(recorded.u).max())
    rounded = max((one.difference for one in compiled), default=0.0)
    if rounded > ROUNDED * largest:
        warnings.append(
            f"rounding changes the controls by up to {rounded:.2g} {unit}, "
            f"{100 * rounded / largest:.2g} % of the largest: leave out --single"
        )
    result = ExportedResult(
        exported=str(flags.run),
        controller=loop.name,
        machine=loop.machine.name,
        contour=recorded.name,
        samples=len(recorded.u),
        preview=law.preview,
        states=law.states,
        control_unit=unit,
        difference=difference,
        largest_control=largest,
        precision=code.precision,
        limits=limits,
        files={name: words for name, (_, words) in texts.items()},
        compiled=compiled,
        warnings=warnings,
    )
    write_result(folder, result)
    return result, folder


def exported_code(loop: StoredLoop, job: Task, single: bool = False) -> tuple[Code, Recorded]:
    """Law and limits of a stored loop, without notes, and the run that it is checked on."""
    machine, controller = loop.machine, loop.controller
    dt = machine.model.dt
    reference = job.reference(dt, max(controller.preview, 1) + 1)
    if isinstance(controller, BacklashCompensation):  # it belongs to whoever hands over the points
        reference, controller = controller.leading(reference), controller.controller
    rollout = simulate(machine.true_family(loop.fed)[0], controller, reference)
    y, u = np.asarray(jax.vmap(row)(rollout.measurement)), np.asarray(rollout.control)
    limit = np.inf if machine.limits.control is None else machine.limits.control
    limits = np.broadcast_to(limit, u.shape[1]).astype(float)
    # Positions of the axes in a measurement
    first = jax.tree.map(lambda leaf: leaf[0], rollout.measurement)
    numbers, unravel = ravel_pytree(first)
    positions = machine.positions(loop.fed)
    places = jax.jacobian(lambda flat: positions(unravel(flat)))(jnp.zeros_like(numbers))
    places = np.asarray(places)
    precision = "single" if single else "double"
    try:
        law = streaming_law(controller, machine.nominal(loop.fed), places, limits, precision)
    except NotAffine as error:
        raise ValueError(
            f"export: {loop.name} has no streaming law: {error}; `jcontour tune --controller` with "
            "another one, as contouring-lq, preview-lq or a cascade, has one"
        ) from None
    position = np.asarray(reference.position)
    safe = safe_limits(_stated(loop, law, position, y, u), places, law.drives, dt)
    return Code(law, safe, (), machine.control_unit, precision), Recorded(job.name, reference, y, u)


def linuxcnc_components(
    loop: StoredLoop, code: Code, display: str = "axis", stock: bool = False
) -> Mapping[str, str]:
    """Files for LinuxCNC by name; with its own PID in place of the law where that is asked for."""
    machine = loop.machine.linear
    if machine is None:
        raise ValueError(
            f"linuxcnc: needs a machine given by A, B, C, {loop.machine.name} is none; "
            "`jcontour identify` makes one from a log"
        )
    axes, limits = machine.model.axes, machine.limits
    count = np.broadcast_to(machine.encoder_resolution, axes).astype(float)
    acceleration = limits.acceleration
    if acceleration is None:
        acceleration = code.limits.speed / SPEED_UP
    title = f"{loop.name} on {machine.name}"
    return linuxcnc_files(
        code,
        machine.mechanics,
        count,
        machine.axes,
        np.broadcast_to(acceleration, axes),
        title,
        display,
        stock_pids(machine.model, np.full(axes, machine.largest_control)) if stock else (),
    )


def _stated(
    loop: StoredLoop,
    law: StreamingLaw,
    position: np.ndarray,
    y: Float[np.ndarray, "T q"],
    u: Float[np.ndarray, "T p"],
) -> Stated:
    limits, axes = loop.machine.limits, law.axes
    linear = loop.machine.linear
    friction = None if linear is None else linear.friction
    noisy = loop.machine.noisy_count
    count = np.broadcast_to(0.0 if noisy is None else noisy, axes)

    def each(limit: float | np.ndarray | None, size: int) -> np.ndarray | None:
        return None if limit is None else np.broadcast_to(limit, size).astype(float)

    return Stated(
        speed=each(limits.speed, axes),
        acceleration=each(limits.acceleration, axes),
        increment=each(limits.increment, law.inputs),
        control=each(limits.control, law.inputs),
        friction=each(friction, law.inputs),
        count=np.maximum(count, SMALLEST),
        fastest=np.abs(np.diff(position, axis=0)).max(axis=0) / law.dt,
        error=np.abs(position[: len(y)] - y @ law.places.T).max(axis=0),
        largest=np.abs(u).max(axis=0),
    )


def _difference(python: str, recorded: Recorded, name: str) -> float:
    """Largest of the exported controls to those of the run."""
    first = slice(0, LOOKED_AT)
    controls, trip = replayed(python, recorded.reference, recorded.y[first], recorded.u)
    apart = float(np.abs(controls - recorded.u[first]).max())
    if trip or not apart <= ALIKE * float(np.abs(recorded.u).max()):
        why = f"it trips ({trip})" if trip else f"the controls differ by {apart:.3g}"
        raise ValueError(
            f"export: on {recorded.name} the law of {name} is not what `simulate` ran: {why}; "
            "does a limit act? Another --along or a lower feed stays within it"
        )
    return apart


def limit_lines(limits: SafeLimits, loop: StoredLoop) -> list[str]:
    """What the law keeps to, in words."""

    def words(values: np.ndarray, scale: float, unit: str) -> str:
        return f"{' '.join(f'{scale * one:.4g}' for one in values)} {unit}"

    stated = "" if loop.machine.limits.speed is not None else " (none stated: twice the run's)"
    lines = [
        f"Speed limit: {feed_words(*limits.speed)}{stated}, "
        f"back to the path {feed_words(*limits.recovery_speed)}.",
        f"Trips: {words(limits.following, 1e3, 'mm')} from the command, "
        f"{words(limits.reach, 1e3, 'mm')} from the path, {limits.lost + 1} samples without a "
        f"measurement, {limits.missed + 1} missed deadlines in a row.",
    ]
    unit = loop.machine.control_unit
    if loop.machine.limits.control is None:
        return [*lines, "No limit of the control is stated: state one in the machine file."]
    control = np.atleast_1d(loop.machine.limits.control)
    each = "no limit" if not np.isfinite(limits.increment).any() else ""
    change = each or words(limits.increment, 1.0, unit)
    return [*lines, f"Control: {words(control, 1.0, unit)}, its change in a sample: {change}."]


def _check_file(recorded: Recorded, unit: str) -> str:
    """Rows of check.csv; the last ones are reference points alone."""
    reference, y, u = recorded.reference, recorded.y, recorded.u
    position, tangent = np.asarray(reference.position), np.asarray(reference.tangent)
    ahead = [(0, len(position) - len(u)), (0, 0)]
    rows = np.hstack([position, tangent, np.pad(y, ahead), np.pad(u, ahead)])
    names = [f"r{k + 1}_m" for k in range(position.shape[1])]
    names += [f"t{k + 1}" for k in range(position.shape[1])]
    names += [f"y{k + 1}" for k in range(y.shape[1])]
    names += [heading(f"u{k + 1}", unit) for k in range(u.shape[1])]
    lines = [",".join(repr(value) for value in one) for one in (rows + 0.0).tolist()]
    return "\n".join([",".join(names), *lines]) + "\n"


def _margins(folder: Path, loop: StoredLoop, law: StreamingLaw) -> tuple[str, list[str]]:
    """Margins of a tuned run in words, and what speaks against loading its weights as code."""
    against = [] if law.exact else [LOOSE]
    if isinstance(loop.controller, BacklashCompensation):
        gaps = in_words(np.asarray(loop.controller.gap))
        against.append(
            f"the code does not compensate the backlash, {gaps}: set it in the control that hands "
            "over the points, as BACKLASH of a joint of LinuxCNC"
        )
    if not loop.tuned:
        return "Margins: not known, the run was one of `simulate`.", against
    tuned = read_result(folder, TunedResult)
    if not tuned.verdict.usable:
        against.insert(0, f"the run ended with {tuned.verdict.heading}")
    margins = tuned.margins
    gains = "; ".join(f"{low:.3g} to {high:.3g}" for low, high in margins.gain_range)
    peak = "" if margins.sensitivity is None else f", Ms {margins.sensitivity:.3g} in the family"
    return f"Margins: gain {gains}, delay {margins.delay_samples} samples{peak}.", against


def show_exported(result: ExportedResult, console: Console) -> None:
    """Files, what they hold, and how the code was compiled."""
    rows = [[name, words] for name, words in result.files.items()]
    console.print(tables.plain_table("Files", ("file", "what it is"), rows, text_columns=2))
    tables.say(
        console,
        *(
            f"Checked: {one.compiler}: no warning, {result.samples} samples within "
            f"{one.difference:.1e} {result.control_unit}, at most {1e-3 * one.slowest:.2g} us"
            for one in result.compiled
        ),
    )
    if "law.c" in result.files and not result.compiled:
        tables.say(console, "Not checked: there is no C compiler here.")
    if "law.st" in result.files:
        tables.say(console, "Not checked: the structured text, which needs a PLC's compiler.")
