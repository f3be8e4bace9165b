"""`jcontour tune`: weights of a controller by gradient, and what is needed to trust them."""

import sys
import time
from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure
from rich.console import Console

from jcontour.app.beside import Beside
from jcontour.app.files import run_folder
from jcontour.app.files.results.stored import to_json, write_result
from jcontour.app.files.results.tuned_result import TunedResult
from jcontour.app.flags.tuning import Tune
from jcontour.app.jobs.job import Job
from jcontour.app.machines.machine import NO_EFFECTS
from jcontour.app.reports import tables
from jcontour.app.reports.figures.axes import drawn_beside
from jcontour.app.reports.figures.contours import figures_of
from jcontour.app.reports.progress import announce, progress_of, working
from jcontour.app.reports.rollouts import save_rollouts, save_sensitivity
from jcontour.app.reports.run_tables import limit_words, show_tuned, tuned_answer
from jcontour.app.reports.screen import Entry
from jcontour.app.runs.checks.recommendation import lost_at_start
from jcontour.app.runs.contour_summary import contour_runs, read_of
from jcontour.app.runs.lifecycle import finished, opened, ranked_words, words_of
from jcontour.app.runs.tuning.problem import PLENTY, TuningRun, tuning_run
from jcontour.app.runs.tuning.results import (
    SHOWN,
    Trial,
    baseline_trial,
    history_of,
    recommended,
    robust_trial,
    shown_contours,
    start_trial,
    suiting_all,
    tried,
    tuned_result,
)
from jcontour.app.runs.tuning.searching import NothingSound, Searched, searched
from jcontour.app.runs.tuning.simple_loops import (
    SimpleLoop,
    best_simple,
    candidates,
    is_chosen,
    simple_loops,
    simple_words,
)

SIMPLE = "simple-loop"  # folder of its search
FIRST = 3  # of many contours, that are named before the tuning


def command(flags: Tune) -> int:
    """The whole command: tune, print, exit code."""
    try:
        result, folder = run(flags, tables.console_of(quiet=flags.json or not flags.details))
    except RuntimeError as error:
        print(f"jcontour: {error}", file=sys.stderr)
        return 1
    named = words_of([str(folder)]).strip()
    answer = [*tuned_answer(result, named), *next_steps(result, folder)]
    return finished(folder, result, flags, show_tuned, answer, result.verdict)


def run(flags: Tune, console: Console) -> tuple[TunedResult, Path]:
    """Tune, or go on tuning; the result and the run folder.

    Raises:
        ValueError: bad input; nothing has been written then.
        RuntimeError: no point could be evaluated without a diverging plant.
    """
    with opened(flags, "tune", tuning_run) as (folder, run):
        describe(run, console)
        return _tuned(run, folder, console), folder


def _tuned(run: TuningRun, folder: Path, console: Console) -> TunedResult:
    began = time.perf_counter()
    size = f"{run.training_samples} samples on {len(run.scenarios.plants)} plants"
    words = f"tuning {run.design.name}, {size}: compiling; points tried are kept in {folder}"
    announce(bar_of(run), words)
    # the start is tried meanwhile, and what of the tuned weights does not wait for the rest
    with Beside(tried.__module__) as process:
        start = start_trial(run, process)
        ends, loops = _candidates(run, folder, console)
        with working(bar_of(run), "trying start and tuned weights on every contour and plant"):
            first = start()
            pairs = [suiting_all(one, first, process) for one in ends]
            chosen, last = recommended(pairs, run, first)
            trials = {"start": first, "tuned": last}
            more_plants = robust_trial(chosen.run, chosen.tuned, process)
            baseline = baseline_trial(run, first, loops)
        if (name := chosen.run.design.name) != run.design.name:
            tables.say(console, f"Recommended: {name}, no usable one is better by more than 10 %.")
        run, tuned = chosen.run, chosen.tuned
        with drawn_beside(figures(run, trials, folder)):
            # Write the runs of the trials, and the gains
            machine = run.machine
            replays = {name: trial.replay for name, trial in trials.items()}
            effects = machine.nonsmooth_effects
            title = f"jcontour tune: start against tuned weights, machine with {effects}"
            line = save_rollouts(run.flags.rollouts, replays, run.scenarios, machine, title, folder)
            tables.say(console, line)
            run.design.save(run.design.build(tuned.weights), run.scenarios, folder)
            curves = {name: trial.curves for name, trial in trials.items()}
            save_sensitivity(curves, run.scenarios.plants, folder)
            with working(bar_of(run), "trying more plants of the family at random"):
                robust = more_plants()
    if baseline is not None:
        trials["baseline"] = baseline
    result = tuned_result(chosen, trials, robust, loops, time.perf_counter() - began)
    # Write the points that were tried, and at last the result
    points = history_of(run, tuned)
    run_folder.write_json(folder / "history.json", to_json(points))
    write_result(folder, result)
    return result


def bar_of(run: TuningRun) -> Console:
    """Where progress is shown."""
    return tables.console_of(stderr=True, quiet=run.flags.json)


def _candidates(
    run: TuningRun, folder: Path, console: Console
) -> tuple[list[Searched], list[SimpleLoop]]:
    """The search of the controller, that of a simple loop where it is as good; the simple loops.

    The search comes first: from its first point on the folder holds something to go on with.
    """
    if is_chosen(run.flags):
        return [_descended(run, folder, console)], []
    descended, failure = None, None
    try:
        descended = _descended(run, folder, console)
    except RuntimeError as error:
        failure = error
    with working(bar_of(run), "trying simple loops"):
        loops = simple_loops(run)
    if loops:
        tables.say(console, f"Simple loops, where they begin: {simple_words(loops)}")

    def search(simple: TuningRun) -> Searched | None:
        place = folder / SIMPLE
        place.mkdir(exist_ok=True)
        announce(bar_of(run), f"tuning {simple.design.name} likewise")
        try:
            return _descended(simple, place, console)
        except RuntimeError:
            return None

    best = best_simple(loops)
    known = [] if descended is None else [descended]
    found = known if best is None else candidates(best, descended, search)
    if not found:
        assert failure is not None
        raise failure
    return found, loops


def _descended(run: TuningRun, folder: Path, console: Console) -> Searched:
    with progress_of(bar_of(run), run.settings, run.machine.error) as show:
        try:
            return searched(run, folder, show, console)
        except NothingSound as error:
            lost = lost_at_start(run)  # what helps a loop that is unstable does not help then
            why = f"with the start, {lost[0]}" if lost else error
            reason = f"no result: {why}; the points tried are kept in {folder}"
            raise RuntimeError(reason) from None


def describe(run: TuningRun, console: Console) -> None:
    """Say what is tuned, on what."""
    machine, flags, scenarios = run.machine, run.flags, run.scenarios
    bounds = [limit_words(name, value) for name, value in run.limits.items()]
    over = "the plant" if flags.nominal_only else "family"
    objective = f"{flags.objective} RMS {machine.error} error over training contours and {over}"
    alone = " (tuned on the nominal plant alone)" if flags.nominal_only else ""
    training = [
        f"{job.name} ({job.samples} samples, {job.feed_law})" for job in scenarios.jobs_seen(True)
    ]
    held_out = _named([f"{job.name} ({job.samples} samples)" for job in scenarios.jobs_seen(False)])
    if flags.parts and any(isinstance(job, Job) for job in scenarios.jobs_seen(True)):
        held_out += "; made in the size, place and feed of the parts, not as `jcontour list` says"
    headings = machine.description() | {
        "Family": "; ".join(scenarios.plants) + alone,
        "Training": _named(training),
        "Held out": held_out,
        **run.design.description(),
        "Objective": f"{objective}; limits: {', '.join(bounds) or 'none'}",
    }
    lines = [f"{heading:<11} {words}" for heading, words in headings.items()]
    reads = [
        tables.read_line(
            job.name, read_of(scenarios.jobs[k], scenarios.references.dt), machine.axes
        )
        for k, job in enumerate(scenarios.jobs)
    ]
    if len(reads) > SHOWN:
        reads = [*reads[:FIRST], f"and {len(reads) - FIRST} more"]
    below = f"\n{'':<14}"  # stops and warnings of a part stand under it
    for k, read in enumerate(reads):
        lines.append(f"{'Read' if k == 0 else '':<11} {read}".replace("\n", below))
    effects = machine.nonsmooth_effects
    if effects != NO_EFFECTS:
        lines.append(
            f"Tuned without {effects} (they have no slope); the tables below are with them."
        )
    if run.by_stretches:
        lines.append(
            f"Long programs are tuned on {len(run.learned)} stretches that represent them, "
            f"{run.training_samples} samples in all; the tables are of the whole."
        )
    if run.training_samples > PLENTY:
        lines.append(f"{run.training_samples} training samples: this takes longer than a minute.")
    tables.say(console, *lines)


def _named(jobs: list[str]) -> str:
    """Names in one line; of many the first ones."""
    if len(jobs) <= SHOWN:
        return "; ".join(jobs)
    return f"{'; '.join(jobs[:FIRST])}; and {len(jobs) - FIRST} more"


def figures(run: TuningRun, trials: Mapping[str, Trial], folder: Path) -> dict[Path, Figure]:
    """Figures of every contour that is shown, by their files."""
    replays, made = {name: trial.replay for name, trial in trials.items()}, {}
    for k in shown_contours(run, replays):
        made |= figures_of(contour_runs(replays, run.scenarios, k, run.machine))
    return {folder / f"{name}.png": figure for name, figure in made.items()}


def next_steps(result: TunedResult, folder: Path) -> list[Entry]:
    """What to load, and the next step with a tuned run; none where it is not to be used."""
    if not result.verdict.usable:
        return []
    entries = [Entry("To load", f"{', '.join(result.files)}, in the folder below")]
    if result.terminal is not None or result.limitable:
        bound = " --bound" * (result.terminal is not None)
        entries.append(Entry("Next", f"jcontour check{words_of([str(folder)])}{bound}"))
    else:
        entries.append(Entry("Next", f"jcontour rank{ranked_words(folder)}"))
    return entries
