"""`jcontour export RUN`: the controller of a run as code for a drive, checked against the run."""

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from rich.console import Console

from jcontour.app.files import run_folder
from jcontour.app.files.results.loop_results import ExportedResult
from jcontour.app.files.results.stored import read_result, write_result
from jcontour.app.files.results.tuned_result import TunedResult
from jcontour.app.flags.loops import Export
from jcontour.app.jobs.job import Job, Task
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.reports import tables
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.checks.exported_code import compiled_checks, off_the_plan, rounding
from jcontour.app.runs.lifecycle import created, finished
from jcontour.app.runs.settling import settling, with_held_end
from jcontour.app.runs.stored_loops import StoredLoop, stored_loop
from jcontour.bounds.affine import NotAffine
from jcontour.export.affine_law import AffineLaw
from jcontour.export.c_code import c_header, c_plan, c_source
from jcontour.export.c_replay import Units, c_plan_reader, c_replay, plan_file, replay_file
from jcontour.export.code_text import Precision
from jcontour.export.drive_law import DriveLaw, DrivePlan, replayed
from jcontour.export.linear_form import linear_form
from jcontour.export.numpy_code import numpy_source
from jcontour.export.structured_text import structured_text
from jcontour.sensors import row
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import stack_plants

ALIKE = 1e-8  # of the largest control: sums in another order differ by less, a limit by more
ROUNDED = 1e-3  # of the largest control: rounding that is told as a warning
AWAY = 1e-4  # [m] from the first point, for which it is told what the control does
ENDS = {  # by whether the planned run comes to rest
    True: "End: the plan rests at the last sample; hold that sample.",
    False: "End: the tool does not rest at the last sample; stop the drive by other means.",
    None: "End: the planned run ends in motion; stop the drive by other means before it does.",
}
LOOSE = (
    "the controller's own limits act on its memory, against windup, in a way that this code leaves "
    "out: do not let the control reach its limit"
)
IN_TABLES = 200_000  # numbers of a plan that are compiled in: about 5 MB of text


def command(flags: Export) -> int:
    """The whole command: write, check, print, exit code."""
    found, folder = run(flags)
    then = "load controller.st, and hand it a line of plan.csv every sample."
    if "controller.c" in found.files:
        then = "compile controller.c and plan.c into the drive, and replay.c beside it once."
    elif "controller.py" in found.files:
        then = "python controller.py in the run folder replays the run."
    answer = [
        Entry("Code", f"{found.controller} on {found.machine}, {found.contour}"),
        Entry("Files", ", ".join(found.files)),
        Entry("Checked", _checked(found)),
        *(Entry("Load", line) for line in (found.start, found.end) if line),
        *(Entry("Warning", line) for line in found.warnings),
        Entry("Next", then),
    ]
    return finished(folder, found, flags, show_exported, answer)


def _checked(found: ExportedResult) -> str:
    """How far the code is off the controls of `simulate`, and what has compiled it."""
    off = f"within {found.difference:.1e} {found.control_unit} of `simulate`"
    compilers = ", ".join(one.compiler.split()[0] for one in found.compiled)
    return f"{off}{'; compiled by ' if compilers else ''}{compilers}"


def run(flags: Export) -> tuple[ExportedResult, Path]:
    """Write the code of a stored run's controller; the result and the run folder.

    Raises:
        ValueError: bad input, or a controller without a linear form; nothing has been written then.
    """
    loop = stored_loop(flags.run)
    named = {job.name: job for job in loop.jobs}
    along = loop.jobs[0].name if flags.along is None else flags.along
    if along not in named:
        raise ValueError(f"along: the run has {', '.join(named)}; received {along!r}")
    job, rests = _until_rest(loop, named[along])
    affine, y, u = _recorded(loop, job)
    largest = float(np.abs(u).max())
    apart = float(np.abs(affine.run(y)[1] - u).max())
    if not apart <= ALIKE * largest:
        raise ValueError(
            f"export: on {job.name} {loop.name} is not its linear form: the controls differ by "
            f"{apart:.3g}; does a limit act? Another --along or a lower feed stays within it"
        )
    law, plan = affine.law, affine.plan_along(_planned(loop, job))
    tried = off_the_plan(law, plan, u)
    precision: Precision = "single" if flags.single else "double"
    rounded, unit = rounding(affine, plan, tried, precision), loop.machine.control_unit
    margins, warnings = _margins(flags.run)
    if rounded > ROUNDED * largest:
        warnings.append(
            f"rounding changes the controls by up to {rounded:.2g} {unit}, "
            f"{100 * rounded / largest:.2g} % of the largest: leave out --single"
        )
    warnings += [] if law.exact else [LOOSE]
    known = loop.machine.sensed if loop.fed == "outputs" else ()
    units = Units(unit, known or ("SI",) * law.measured)  # a state is in SI, that is all we know
    start, end = _start(loop, law, plan, units), ENDS[rests]
    notes = [*_notes(flags, loop, job), start, end, *margins, *warnings]
    texts = _texts(flags, law, plan, notes, job.name, precision)
    texts["plan.csv"] = plan_file(law, plan, units), "the plan, a line for every sample"
    told = "the run with a wave on what it measures, and the controls in double"
    texts["replay.csv"] = replay_file(tried, affine.run(tried)[1], units), told
    folder = created(flags, "export")
    for name, (text, _) in texts.items():
        run_folder.write(folder / name, lambda path, text=text: path.write_text(text))
    result = ExportedResult(
        exported=str(flags.run),
        controller=loop.name,
        machine=loop.machine.name,
        contour=job.name,
        samples=plan.steps,
        states=law.states,
        gain_sets=max(1 if sets is None else len(sets) for sets in (plan.F, plan.D)),
        in_tables=plan.numbers <= IN_TABLES,
        control_unit=unit,
        difference=apart,
        rounding=rounded,
        largest_control=largest,
        precision=precision,
        files={name: words for name, (_, words) in texts.items()},
        compiled=compiled_checks(folder) if "controller.c" in texts else [],
        start=start,
        end=end,
        warnings=warnings,
    )
    write_result(folder, result)
    return result, folder


def _until_rest(loop: StoredLoop, job: Task) -> tuple[Task, bool | None]:
    """The run with its end held until the nominal tool rests, and whether it does.

    None of a run that ends in motion.
    """
    if isinstance(job, Job) and not job.at_rest:
        return job, None
    machine, dt = loop.machine, loop.machine.model.dt
    linear = machine.form(LinearMachine)
    nominal = (machine.true_family if linear is None else linear.exact_family)(loop.fed)[0]
    samples = settling(job, stack_plants([nominal]), loop.controller, dt)
    return with_held_end(job, samples or 0), samples is not None


def _start(loop: StoredLoop, law: DriveLaw, plan: DrivePlan, units: Units) -> str:
    """Where the axes have to stand for sample 0, and what a step away from there asks for."""
    places, kicks = [], []
    free = replace(law, limit=np.full(law.inputs, np.inf))
    first = replace(plan, used=plan.used[:1], f=plan.f[:1], r=plan.r[:1], m=None)
    for k, (place, unit) in enumerate(zip(plan.r[0], units.measured, strict=True)):
        shown = f"{round(1e3 * place, 4) + 0.0:.4f} mm" if unit == "m" else f"{place:.6g} {unit}"
        places.append(f"y{k + 1} = {shown}")
        if unit == "m":
            moved = plan.r[:1] + AWAY * (np.arange(law.measured) == k)
            kicks.append(float(np.abs(replayed(free, first, moved) - plan.f[:1]).max()))
    told = f"Start at rest at the path's first point: {', '.join(places)}."
    if not kicks:
        return told
    size = f"{max(kicks):.3g} {loop.machine.control_unit}"
    return f"{told} From {1e3 * AWAY:g} mm beside it the control jumps by up to {size} at once."


def _recorded(loop: StoredLoop, job: Task) -> tuple[AffineLaw, np.ndarray, np.ndarray]:
    """Law, and measurements and controls of a run on the nominal machine as it is."""
    machine, controller = loop.machine, loop.controller
    reference = job.reference(machine.model.dt, controller.preview)
    found = simulate(machine.true_family(loop.fed)[0], controller, reference)
    y, u = np.asarray(jax.vmap(row)(found.measurement)), np.asarray(found.control)
    limit = np.inf if machine.limits.control is None else machine.limits.control
    try:
        limits = np.broadcast_to(limit, u.shape[1]).astype(float)
        affine = linear_form(controller, reference, found, limits)
    except NotAffine as error:
        raise ValueError(
            f"export: {loop.name} has no linear form: {error}; `jcontour tune --controller` with "
            "another one, as contouring-lq, preview-lq or a cascade, has one"
        ) from None
    return affine, y, u


def _planned(loop: StoredLoop, job: Task) -> Float[np.ndarray, "T q"]:
    """Measurements about which the law is written: those of the nominal model on the reference.

    The law is the same about any of them. About the reference the plan ends where the program does,
    without counts and noise. At every sample the model is in steady motion through the reference;
    positions are then the reference itself.
    """
    reference = job.reference(loop.machine.model.dt, loop.controller.preview)
    plant, steps = loop.machine.nominal(loop.fed), reference.steps
    position = jnp.asarray(reference.position)[:steps]
    increment = jnp.diff(position, axis=0, prepend=position[:1] - reference.start_increment[None])

    def measured(position: Array, increment: Array) -> Array:
        return row(plant.measure(plant.initial_state(position, increment)))

    return np.asarray(jax.vmap(measured)(position, increment))


def _texts(
    flags: Export,
    law: DriveLaw,
    plan: DrivePlan,
    notes: list[str],
    name: str,
    precision: Precision,
) -> dict[str, tuple[str, str]]:
    """Text and meaning of every source file."""
    texts = {}
    if flags.c or not (flags.st or flags.python):
        in_tables = plan.numbers <= IN_TABLES
        tables = c_plan(plan, name, precision) if in_tables else c_plan_reader(plan)
        told = "the plan as tables" if in_tables else "reads plan.csv, for a computer with files"
        texts["controller.h"] = c_header(law, plan, notes, precision), "sizes, units, family"
        texts["controller.c"] = c_source(law, plan, precision), "drive_init and drive_step"
        texts["plan.c"] = tables, told
        texts["replay.c"] = c_replay(), "replays the run; its head says how to compile it"
    if flags.st:
        text = structured_text(law, plan, notes, precision)
        texts["controller.st"] = text, "function block; a line of plan.csv goes in every sample"
    if flags.python:
        texts["controller.py"] = numpy_source(law, plan, notes), "replays the run when it is run"
    return texts


def _notes(flags: Export, loop: StoredLoop, job: Task) -> list[str]:
    """What the code is, for its head."""
    machine = loop.machine
    version = run_folder.version_of("jcontour") or "unknown"
    measured = "positions" if loop.fed == "outputs" else "the state"
    return [
        f"{loop.name} on {machine.name}, written by jcontour {version} from {flags.run.name}",
        f"Axes: {', '.join(machine.axes)}. y: {measured} as `simulate` measures them, SI units.",
        f"u: {machine.control_unit}.",
        f"Family: {'; '.join(machine.family_names)}.",
        f"Plan: {job.name}, {job.feed_law}, {job.steps} samples.",
    ]


def _margins(folder: Path) -> tuple[list[str], list[str]]:
    """Margins of a tuned run in words, and what speaks against loading its weights."""
    if run_folder.read_json(folder, run_folder.SETTINGS).get("command") != "tune":
        return ["Margins: not known, the run was one of `simulate`."], []
    tuned = read_result(folder, TunedResult)
    margins = tuned.margins
    gains = "; ".join(f"{low:.3g} to {high:.3g}" for low, high in margins.gain_range)
    peak = "" if margins.sensitivity is None else f", Ms {margins.sensitivity:.3g} in the family"
    told = f"Margins: gain {gains}, delay {margins.delay_samples} samples{peak}."
    against = [] if tuned.verdict.usable else [f"the run ended with {tuned.verdict.heading}"]
    return [told], against


def show_exported(found: ExportedResult, console: Console) -> None:
    """Files, what they hold, and how they were checked."""
    title = f"{found.controller} on {found.machine}: {found.contour}, {found.samples} samples"
    rows = [[name, words] for name, words in found.files.items()]
    console.print(tables.plain_table(title, ("file", "what it is"), rows, text_columns=2))
    sets = "one gain" if found.gain_sets == 1 else f"{found.gain_sets} different gains"
    tables.say(
        console,
        f"It remembers {found.states} numbers, and has {sets} along the path.",
        f"Its equations give the controls of `simulate` within {found.difference:.1e} "
        f"{found.control_unit}; the largest is {found.largest_control:.3g}.",
        f"Off its plan, numbers in {found.precision} precision change the controls by up to "
        f"{found.rounding:.1e} {found.control_unit}.",
        *(
            f"Checked: {one.compiler}: no warning, controls off the plan within "
            f"{one.difference:.1e} {found.control_unit}, {one.nanoseconds:.0f} ns a step"
            for one in found.compiled
        ),
    )
    if "controller.c" in found.files and not found.compiled:
        tables.say(console, "Not checked: there is no C compiler here.")
    if "controller.st" in found.files:
        tables.say(console, "Not checked: the structured text, which needs a PLC's compiler.")
    if not found.in_tables:
        tables.say(console, "The plan is too long for tables: plan.csv holds it, line by line.")
    tables.say(console, *(line for line in (found.start, found.end) if line))
    tables.say(console, *(f"WARNING: {line}" for line in found.warnings))
