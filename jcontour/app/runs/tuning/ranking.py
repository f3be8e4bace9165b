"""Controllers tuned alike and ranked on held-out contours.

Each one has a folder of its own in the run folder, with the state of its tuner and its row once it
is tuned, so that an interrupted ranking goes on where it was.
"""

import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console

from jcontour.app.catalogue.choices import (
    UnreadFlagWarning,
    controllers_for,
    design_for,
    job_named,
    learns,
    machine_named,
)
from jcontour.app.designs.design import Design, given, plain_weights
from jcontour.app.files import run_folder
from jcontour.app.files.checkpoints import load_state, save_state
from jcontour.app.files.results.search_results import Ranked, RankedResult
from jcontour.app.files.results.stored import from_json, to_json
from jcontour.app.files.results.verdict import ROUNDING, Verdict, exceeded, reason, warning
from jcontour.app.flags.shared import Aimed
from jcontour.app.flags.tuning import Rank, Tune
from jcontour.app.jobs.job import Pace
from jcontour.app.jobs.replays import replay
from jcontour.app.machines.machine import Machine
from jcontour.app.reports.progress import progress_of
from jcontour.app.runs.checks.machine_limits import machine_limits
from jcontour.app.runs.checks.recommendation import ALONE, STATED
from jcontour.app.runs.contour_summary import machine_summary
from jcontour.app.runs.tuning.limits import family_peaks, loop_limits
from jcontour.app.runs.tuning.problem import TuningRun, tuning_run
from tuning.problem import QUICK
from tuning.tuner import Tuned, advance, result

# as much as the evaluations allow: several descents, each to its end
EFFORT = replace(QUICK, starts=3, scatter=8, steps=40, tolerance=1e-4, every_start=True)
ROW = "row.json"
TIMED = 3  # runs, of which the fastest counts: others wait for the computer


@dataclass(frozen=True)
class Ranking:
    """A ranking that is asked for."""

    flags: Rank  # as they are given
    machine: Machine  # what the controllers are for
    # by name, in the order in which they are tuned; None of one that cannot be made
    designs: Mapping[str, Design | None]
    # the first run that can be, made already
    begun: Mapping[str, TuningRun] = field(default_factory=dict)

    @property
    def learning(self) -> list[str]:
        """Names that are left out, as no margin is known of what they learn."""
        if self.flags.controllers:
            return []
        return [name for name in controllers_for(self.machine) if learns(name)]

    def run_of(self, name: str) -> TuningRun:
        """Tuning run of one controller."""
        if name in self.begun:
            return self.begun[name]
        shared: dict[str, Any] = {one.name: getattr(self.flags, one.name) for one in fields(Aimed)}
        flags = Tune(**{**shared, "controller": name, "parts": self.flags.parts})
        return tuning_run(flags, self.designs.get(name))


def ranking_of(flags: Rank) -> Ranking:
    """The ranking that flags describe."""
    if flags.controller is not None:
        raise ValueError("controller: a ranking takes several; name them with --controllers")
    if given(flags):
        raise ValueError("weights: every controller of a ranking begins at its own; leave it out")
    if flags.evaluations < 1:
        raise ValueError(f"evaluations: needs at least 1, received {flags.evaluations}")
    loop_limits(flags)
    machine = machine_named(flags.plant)
    for part in flags.parts:  # a fault in one is reported before any first loop is searched
        job_named(part, Pace.of(flags, machine))
    designs = _designs(flags, machine)
    if not designs:
        raise ValueError(f"controllers: none of the catalogue suits {machine.name}")
    ranking, reasons = Ranking(flags, machine, designs), []
    for name in designs:  # the first run that can be made
        try:
            return replace(ranking, begun={name: ranking.run_of(name)})
        except ValueError as error:
            reasons.append(error)
    raise reasons[0]  # parts, limits or names are wrong


def _designs(flags: Rank, machine: Machine) -> dict[str, Design | None]:
    """Controllers by name; a first loop takes a while to find."""
    designs: dict[str, Design | None] = {}
    suiting = [name for name in controllers_for(machine) if not learns(name)]
    for name in flags.controllers or suiting:
        try:
            with warnings.catch_warnings():  # the flags are for those that read them
                warnings.simplefilter("ignore", UnreadFlagWarning)
                design = design_for(machine, replace(flags, controller=name))
        except ValueError:  # reported in its row
            designs[name] = None
            continue
        if design.fed == "outputs" or flags.controllers:  # the state is more than the others see
            designs[name] = design
    return designs


def ranked(ranking: Ranking, folder: Path, console: Console) -> RankedResult:
    """Tune and rank; what is stored in the run folder counts."""
    rows = []
    for index, name in enumerate(ranking.designs):
        place = folder / f"{index:02d}-{Path(name.replace(':', '-')).name}"
        place.mkdir(exist_ok=True)
        if (place / ROW).exists():
            rows.append(from_json(run_folder.read_json(place, ROW), Ranked))
        else:
            console.print(f"{index + 1} of {len(ranking.designs)}: {name}")
            rows.append(_row(ranking, name, place, console))
            run_folder.write_json(place / ROW, to_json(rows[-1]))
            jax.clear_caches()  # programs of all controllers: more maps of memory than Linux gives
    machine, rows = ranking.machine, sorted(rows, key=_place)
    return RankedResult(
        machine=machine_summary(machine),
        error=machine.error,
        evaluations=ranking.flags.evaluations,
        rows=rows,
        verdict=verdict_on(
            rows,
            [*machine.remarks, *([f"{ALONE}: {STATED}"] if len(machine.family_names) == 1 else [])],
        ),
        learning=ranking.learning,
    )


def verdict_on(rows: Sequence[Ranked], warnings: Sequence[str]) -> Verdict:
    """Verdict on a ranking: a controller follows every contour within every limit."""
    usable = [row.label for row in rows if row.failure is None and row.feasible]
    messages = [warning(line) for line in warnings]
    if usable:
        return Verdict.of([], messages, passed=f"USE {usable[0]}, tuned")
    messages.append(reason("no controller keeps every limit"))
    for row in rows:
        limits = "; ".join(row.exceeded) or "beyond a limit of the tuner"
        messages.append(reason(f"{row.label}: {row.failure or limits}"))
    return Verdict.of([], messages, passed="USE ANY OF THEM")


def _row(ranking: Ranking, name: str, place: Path, console: Console) -> Ranked:
    """One controller, tuned and tried; a controller that cannot be is a row with the reason."""
    try:
        run = ranking.run_of(name)
        run = replace(run, settings=replace(EFFORT, seed=ranking.flags.seed))
        with progress_of(console, run.settings, run.machine.error) as show:
            state = load_state(place)
            while not state.done and len(state.history) < ranking.flags.evaluations:
                state = advance(run.problem, run.start, run.settings, state)
                save_state(place, state)
                show(state)
        tuned = result(run.problem, run.start, state)  # raises where every point diverged
        return _tried(run, tuned, Ranked(label=name))
    except run_folder.RunError:  # of its files, not of the controller
        raise
    except ValueError as error:
        return Ranked(label=name, failure=str(error))


def _tried(run: TuningRun, tuned: Tuned, row: Ranked) -> Ranked:
    """The tuned controller on the machine with all effects."""
    controller = run.controller(tuned.weights)
    tried = replay(controller, run.scenarios)
    seconds = []
    for _ in range(TIMED):
        began = time.process_time()
        replay(controller, run.scenarios)
        seconds.append(time.process_time() - began)
    loops, sound, bound = tuned.outcome.loops, bool(tuned.feasible), run.flags.max_sensitivity
    if run.flags.nominal_only:  # the tuner saw one plant of the family
        loops = family_peaks(controller, run.machine, run.scenarios, run.design.fed)
        sound &= bound is None or bool(np.max(loops.sensitivity) <= (1 + ROUNDING) * bound)
    peak = np.inf if loops is None else float(np.max(loops.sensitivity))
    limits = machine_limits(tried, run.scenarios, run.machine)
    worst = np.max(getattr(tried.metrics, f"rms_{run.machine.error}_error"), axis=1)
    errors: dict[bool, dict[str, float]] = {True: {}, False: {}}
    for job, seen, error in zip(run.scenarios.jobs, run.scenarios.training, worst, strict=True):
        errors[bool(seen)][job.name] = float(error)
    typical = {
        seen: float(np.exp(np.mean(np.log(list(of.values()))))) if of else None
        for seen, of in errors.items()
    }
    tuned_row = replace(
        row,
        held_out_errors=errors[False],
        training_errors=errors[True],
        held_out=typical[False],
        training=typical[True],
        peak_sensitivity=peak if np.isfinite(peak) else None,
        learns=run.design.learns,
        feasible=sound and all(one.kept for one in limits),
        exceeded=exceeded(limits),
        stationary=bool(tuned.stationary),
        evaluations=len(tuned.history),
        weights=plain_weights(tuned.weights),
        seconds=min(seconds),
    )
    lost = np.asarray(tried.metrics.diverged)
    if not lost.any():
        return tuned_row
    names = [job.name for job, one in zip(run.scenarios.jobs, lost, strict=True) if one.any()]
    return replace(tuned_row, failure=f"a plant of the family diverges on {', '.join(names)}")


def _place(row: Ranked) -> tuple[bool, bool, float]:
    """Sound rows first, then those beyond a limit, each by its held-out error."""
    error = np.inf if row.held_out is None else row.held_out
    return row.failure is not None, not row.feasible, error
