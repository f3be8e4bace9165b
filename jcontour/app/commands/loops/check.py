"""`jcontour check RUN`: a stored run under limits, its largest error proven, or in LinuxCNC."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from jcontour._arrays import check_above_zero
from jcontour.app.files import run_folder
from jcontour.app.files.netcdf import Variables, save_variables
from jcontour.app.files.results.run_metrics import RunMetrics
from jcontour.app.files.results.stored import Weight, read_result, write_result
from jcontour.app.files.results.tuned_result import TunedResult
from jcontour.app.files.results.verdict import LimitCheck, Message, Verdict, reason, warning
from jcontour.app.flags.loops import Check
from jcontour.app.flags.tuning import Tune
from jcontour.app.machines.machine import Machine
from jcontour.app.plain_numbers import MM_PER_MIN
from jcontour.app.reports import tables
from jcontour.app.reports.progress import counted
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.lifecycle import created, finished, task_words, words_of
from jcontour.app.runs.stored_loops import stored_tuning
from jcontour.controllers.feedforward.inverse_feedforward import FrictionFeedforward
from jcontour.controllers.wrappers.adapters import BacklashCompensation
from jcontour.host.held import FrictionCompensated
from jcontour.mpc.tracking.limits import Limits
from jcontour.qp.solvers import solver_named
from jcontour.simulation.evaluation import member
from tuning.verification import Gap, verify

OF_LIMITS = ("max_control", "max_increment", "max_speed_mm_per_min", "max_acceleration")
OF_LIMITS += ("fallback", "solver")
OF_BOUND = ("force", "encoder_um")


def command(flags: Check) -> int:
    """The check that is asked for; exit code."""
    if flags.bound and flags.in_linuxcnc:
        raise ValueError("check: --in-linuxcnc does not go with --bound")
    kind = "bound" if flags.bound else "in-linuxcnc" if flags.in_linuxcnc else ""
    defaults = {one.name: one.default for one in fields(Check)}
    for name in (*OF_LIMITS, *OF_BOUND):
        mine = name in OF_BOUND if flags.bound else name in OF_LIMITS and not flags.in_linuxcnc
        if getattr(flags, name) != defaults[name] and not mine:
            other = f"does not go with --{kind}" if kind else "needs --bound"
            raise ValueError(f"check: --{name.replace('_', '-')} {other}")
    if flags.in_linuxcnc:
        from jcontour.app.commands.loops import check_in_linuxcnc

        return check_in_linuxcnc.command(flags)
    if flags.bound:
        from jcontour.app.commands.loops import check_bound

        return check_bound.command(flags)
    return check_limits(flags)


FLAGS = {  # limit -> flag, factor to SI
    "control": ("max_control", 1.0),
    "increment": ("max_increment", 1.0),
    "acceleration": ("max_acceleration", 1.0),
    "speed": ("max_speed_mm_per_min", MM_PER_MIN),
}
AWAY = {  # limit -> flag of `tune` that keeps a loop further away from it, factor to SI
    "control": ("max_peak_control", 1.0),
    "increment": ("max_peak_increment", 1.0),
    "acceleration": ("acceleration", 1.0),
    "speed": ("feed_mm_per_min", MM_PER_MIN),
}
FURTHER = 0.9  # of a limit that is kept: what the next tuning is asked for
UNITS = {"speed": "m/s", "acceleration": "m/s^2"}  # of limits on axes; others are in control units
COUNTED = 0.01  # of a limit: what counted measurements add is less
REACHED = "Largest value on every sample, of its limit"
HEADINGS = (
    "contour, plant",
    "limit\nin\nplan %",
    "\nacts\n%",
    "RMS um\ncontour\ntuned",
    "\nwith\nlimits",
    "RMS um\ntrack\ntuned",
    "\nwith\nlimits",
)


@dataclass(frozen=True)
class GapRow:
    """One contour on one plant, see `tuning.verification.Gap`."""

    contour: str
    plant: str
    active_fraction: float
    acting_fraction: float
    residual: float
    fallbacks: int
    stopped: int | None
    failure: str
    reached: dict[str, list[float]]
    without: RunMetrics
    within: RunMetrics | None

    @classmethod
    def of(cls, gap: Gap) -> "GapRow":
        """Numbers of a gap that are stored."""
        of_run = {"residual": gap.run.report.worst_residual}
        for name in ("active_fraction", "acting_fraction", "fallbacks"):
            of_run[name] = getattr(gap.run.report, name)
        known = gap._asdict() | of_run
        values: dict[str, Any] = {one.name: known[one.name] for one in fields(cls)}
        for name in ("without", "within"):
            if values[name] is not None:
                values[name] = RunMetrics.of(values[name], lambda value: value.item())
        values["reached"] = {name: largest.tolist() for name, largest in gap.reached.items()}
        return cls(**values)

    @property
    def added_error(self) -> float:
        """RMS contour error under limits beyond that of the tuned controller [m]."""
        if self.within is None:
            return 0.0
        return self.within.rms_contour_error - self.without.rms_contour_error


@dataclass(frozen=True)
class Verified:
    """Result of `check`."""

    tuned: str  # folder of the tuned run
    tuned_verdict: Verdict  # of `tune` on its weights
    weights: dict[str, Weight]  # its weights by name
    solver: str
    # lower and upper bounds by the name of the signal, None where there are none
    limits: dict[str, list | None]
    gaps: list[GapRow]  # one row per contour and plant
    control_unit: str  # of the machine
    verdict: Verdict  # whether every run goes through, within every limit


def check_limits(flags: Check) -> int:
    """The whole command: replay, print, exit code.

    Every run is stored as it is done: kept if the rest is interrupted.
    """
    run, weights = stored_tuning(flags.run)
    machine, scenarios = run.machine, run.scenarios
    tuned, solver = read_result(flags.run, TunedResult), solver_named(flags.solver)
    limits = limits_of(flags, machine)
    constrained = run.design.constrained(weights, limits, solver)
    if constrained is None:
        raise ValueError(
            f"check: {run.design.name} has no form that keeps to limits at every sample; "
            "contouring-lq has one"
        )
    controller, leading = run.controller(weights), None
    if isinstance(controller, BacklashCompensation):
        controller, leading = controller.controller, controller.leading
    if leading is not None and not isinstance(controller, FrictionFeedforward):
        controller = FrictionFeedforward(controller, 0.0)
    if isinstance(controller, FrictionFeedforward):
        constrained = FrictionCompensated(constrained, controller, leading)
    references = {
        job.name: job.reference(machine.model.dt, run.design.preview) for job in scenarios.jobs
    }
    plants = {name: member(scenarios.family, k) for k, name in enumerate(scenarios.plants)}
    for reference in references.values():
        constrained.initial_memory(reference)  # raises what does not fit before anything is written
    out = created(flags, "check")
    fallback = None if flags.fallback == "stop" else flags.fallback
    rows, count = [], len(references) * len(plants)
    replays = verify(run.controller(weights), constrained, limits, references, plants, fallback)
    with counted(tables.console_of(stderr=True, quiet=flags.json), count) as done:
        for gap in replays:
            rows.append(GapRow.of(gap))
            _save(gap, len(rows), machine, out)
            run_folder.write_json(out / "gaps.json", rows)
            done(1)
    bounds = {
        name: None if pair is None else [np.asarray(bound).tolist() for bound in pair]
        for name, pair in limits._asdict().items()
    }
    unit = machine.control_unit
    against = [one for one in tuned.verdict.messages if one.level == "reason"]
    result = Verified(
        tuned=str(flags.run),
        tuned_verdict=tuned.verdict,
        weights=tuned.weights,
        solver=solver.name,
        limits=bounds,
        gaps=rows,
        control_unit=unit,
        verdict=verdict_on(rows, bounds, unit, against),
    )
    write_result(out, result)
    answer = _answer(rows, result.verdict, flags, run_folder.opened(flags.run, "tune")["flags"])
    return finished(out, result, flags, show, answer, result.verdict)


def limits_of(flags: Check, machine: Machine) -> Limits:
    """The machine's limits, each replaced where a flag gives another."""
    sizes = {}
    for name, (flag, factor) in FLAGS.items():
        value = getattr(flags, flag)
        if value is None:
            sizes[name] = getattr(machine.limits, name)
            continue
        check_above_zero(**{flag.replace("_", "-"): value})
        sizes[name] = factor * value
    if all(size is None for size in sizes.values()):
        raise ValueError(
            f"check: {machine.name} states no limits; give --max-control, --max-increment, "
            "--max-speed-mm-per-min or another"
        )
    return Limits.within(**sizes)


def _save(gap: Gap, number: int, machine: Machine, folder: Path) -> None:
    """The constrained run, or what there is of one that stopped."""
    rollout, report = gap.run.rollout, gap.run.report
    if len(rollout.output) == 0:
        return
    output, control = np.asarray(rollout.output), np.asarray(rollout.control)
    fallback, time = report.fallback.astype("i1"), machine.model.dt * np.arange(len(output))
    active = {"long_name": "limits active in the plan of the step"}
    acting = {"long_name": "of these, limits on what the control of the step alone decides"}
    residual = {"long_name": "largest scaled residual of the QP"}
    data: Variables = {
        "time": (("time",), time, {"units": "s"}),
        "axis": (("axis",), list(machine.axes), {}),
        "output": (("time", "axis"), output, {"units": "m"}),
        "control": (("time", "input"), control, {"units": machine.control_unit}),
        "active": (("time",), report.active, active),
        "acting": (("time",), report.acting, acting),
        "residual": (("time",), report.residual, residual),
        "fallback": (("time",), fallback, {"long_name": "1 where the fallback acted"}),
    }
    title = {
        "title": "jcontour check: under limits",
        "contour": gap.contour,
        "plant": gap.plant,
        "failure": gap.failure,
        **run_folder.versions(),
    }
    save_variables(data, title, folder / f"run-{number:02d}-{gap.contour}.nc")


def show(result: Verified, console: Console) -> None:
    """The verdict of `tune` where it was against the weights, the gap table, what stopped."""
    if not result.tuned_verdict.usable:
        tables.say(console, f"`tune` said of {result.tuned}:", *result.tuned_verdict.lines, "")
    names = [name for name, bounds in result.limits.items() if bounds is not None]

    def costs(gap: GapRow) -> list[str]:
        limited = (gap.active_fraction, gap.acting_fraction)
        errors = []
        for name in ("rms_contour_error", "rms_tracking_error"):
            for run in (gap.without, gap.within):
                errors.append("-" if run is None else tables.digits(1e6 * getattr(run, name)))
        return [*(tables.digits(100 * share) for share in limited), *errors]

    def largest(gap: GapRow) -> list[list[str]]:  # value, "of", limit, unit
        checks = (_limit_check(gap, name, result.limits, result.control_unit) for name in names)
        return [one.size.split(" ", 3) for one in checks]

    title = f"Tuned weights under limits on {', '.join(names)} ({result.solver})"
    console.print(tables.plain_table(title, HEADINGS, _by_contour(result.gaps, costs)))
    tables.say(
        console,
        "limit in plan: steps whose horizon touches a limit",
        "limit acts: steps whose own control is kept by one, of the control, its change,",
        "or the next speed or acceleration of the model",
    )
    units = [(*words, "")[3] for words in largest(result.gaps[0])]
    headings = [f"{name}\n{unit}" for name, unit in zip(names, units, strict=True)]
    rows = _by_contour(result.gaps, lambda gap: [" ".join(one[:3]) for one in largest(gap)])
    console.print(tables.plain_table(REACHED, [HEADINGS[0], *headings], rows))
    residuals = [gap.residual for gap in result.gaps if np.isfinite(gap.residual)]
    if residuals:
        tables.say(console, f"Largest scaled residual of a QP: {max(residuals):.1e}")


def _by_contour(gaps: Sequence[GapRow], cells: Callable[[GapRow], list[str]]) -> list[list[str]]:
    """The plants below the name of their contour."""
    rows = []
    for contour in dict.fromkeys(gap.contour for gap in gaps):
        rows.append([contour])
        rows += [[f"  {gap.plant}", *cells(gap)] for gap in gaps if gap.contour == contour]
    return rows


def _limit_check(
    gap: GapRow, name: str, limits: Mapping[str, list | None], control_unit: str
) -> LimitCheck:
    """Largest value of a limited signal and its limit, on the axis that uses most of it."""
    bounds = limits[name]
    assert bounds is not None
    largest = np.asarray(gap.reached[name])
    most = np.broadcast_to(bounds[1], largest.shape)
    axis = int(np.argmax(largest / most))
    per = f"{control_unit} per sample" if name == "increment" else control_unit
    return LimitCheck(
        name=name,
        value=float(largest[axis]),
        allowed=float(most[axis]),
        unit=UNITS.get(name, per),
        member=f"{gap.contour}, {gap.plant}",
        slack=COUNTED,
    )


def verdict_on(
    rows: list[GapRow],
    limits: Mapping[str, list | None],
    unit: str,
    tuned: Sequence[Message] = (),
) -> Verdict:
    """Verdict on runs under limits: every one goes through, within every limit.

    What spoke against the tuned weights besides limits still does: no constraint mends a margin.

    Args:
        rows: of the table.
        limits: lower and upper bounds by name; None where there are none.
        unit: of the controls.
        tuned: reasons of `tune` against the weights, besides limits.
    """
    checks = []
    for name in (name for name, bounds in limits.items() if bounds is not None):
        reached = [_limit_check(row, name, limits, unit) for row in rows if name in row.reached]
        # runs at a limit are equal to the tolerance of the QP
        checks += sorted(reached, key=lambda one: round(one.value / one.allowed, 6))[-1:]
    messages = [*tuned]
    for row in rows:
        where = f"{row.contour}, {row.plant}"
        if row.failure:
            messages.append(reason(f"stopped: {where}: {row.failure}"))
        if row.fallbacks:
            messages.append(warning(f"the fallback acts at {row.fallbacks} steps: {where}"))
    helps = ["the model keeps to its limits; another plant, counts or a fallback may not"]
    return Verdict.of(checks, messages, helps, "USE THESE VALUES UNDER THEIR LIMITS")


def _answer(
    rows: list[GapRow], verdict: Verdict, flags: Check, tuned: Mapping[str, Any]
) -> list[Entry]:
    """Cost of the limits, the one that is used most, and the next command."""
    lost = [row for row in rows if row.failure]
    used = max(verdict.limits, key=lambda one: one.value / one.allowed, default=None)
    most = [] if used is None else [Entry("Limit", f"most used: {used.name} {used.size}")]
    if lost and flags.fallback == "stop":
        stopped = f"{len(lost)} of {len(rows)} runs: a step had no answer within the limits"
        again = task_words([str(flags.run)], {**vars(flags), "fallback": "soft"}, Check)
        return [Entry("Stopped", stopped), *most, Entry("Next", f"jcontour check{again}")]
    if not any(row.active_fraction > 0 for row in rows):
        kept = "no limit was ever active: the tuned controller itself keeps to all of them"
        return [
            Entry("Error", kept),
            *most,
            Entry("Next", f"jcontour export{words_of([str(flags.run)])}"),
        ]
    # Tune again, further away from the limit that is exceeded, or else used, most
    away = dict(tuned)
    if used is not None:
        name, unit = AWAY[used.name]
        share = FURTHER * min(1.0, used.allowed / used.value)
        away[name] = float(f"{share * (tuned.get(name) or used.allowed / unit):.3g}")
    again = Entry("Next", f"jcontour tune{task_words(tuned['parts'], away, Tune)}")
    if not verdict.usable:
        return [*most, again]
    worst = max(rows, key=lambda row: row.added_error)
    assert worst.within is not None
    before, after = (1e6 * one.rms_contour_error for one in (worst.without, worst.within))
    sizes = f"{tables.digits(before)} -> {tables.digits(after)} um"
    cost = f"the limits add most on {worst.contour}, {worst.plant}: RMS contour {sizes}"
    return [Entry("Error", cost), *most, again]
