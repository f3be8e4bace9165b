"""`jcontour audit LOG`: the contour error of a record of any control, and its causes."""

from typing import cast

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.app.commands.machines.identify import check_columns, log_of
from jcontour.app.files import run_folder
from jcontour.app.files.results.loop_results import AuditedResult
from jcontour.app.files.results.run_metrics import MachineSummary, RunMetrics
from jcontour.app.files.results.stored import write_result
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.flags.machines import Audit
from jcontour.app.jobs.replays import Replay, Scenarios
from jcontour.app.reports.causes import audit_answer, cause_shares, show_causes
from jcontour.app.reports.figures.axes import save_figure
from jcontour.app.reports.figures.contours import ContourRuns, DrawnRun, figures_of
from jcontour.app.reports.figures.loops import causes_figure
from jcontour.app.reports.rollouts import save_rollouts
from jcontour.app.runs.contour_summary import peak_place, read_of
from jcontour.app.runs.lifecycle import finished
from jcontour.app.runs.measured_run import MEASURED, measured_run
from jcontour.plant import Plant
from jcontour.simulation.metrics import score_signals
from tuning.identification.error_causes import shares
from tuning.identification.linear.validation import resolution_of


def counts_of(signal: np.ndarray) -> np.ndarray:
    """Counts of axes [m], of steps too: a steady motion visits few of its counts."""
    steps = np.diff(signal, axis=0).round(12)
    return np.array([min(map(resolution_of, pair)) for pair in zip(signal.T, steps.T, strict=True)])


def command(flags: Audit) -> int:
    """Read, score, explain, store and print; exit code."""
    if flags.data is None:
        raise ValueError("audit: needs a log with a command and a position for each axis")
    check_columns(flags)
    log = log_of(flags, asked=True)
    run = measured_run(log, flags.data.stem, flags.part, flags.axes)
    error, _ = run.error(run.tool)
    metrics = jax.tree.map(
        lambda one: np.asarray(one)[None, None],
        score_signals(jnp.asarray(run.tool), jnp.asarray(run.command), run.reference),
    )
    replayed = Replay(metrics, *(one[None, None] for one in (run.tool, run.command, error)))
    counts = np.stack([counts_of(signal) for signal in (run.tool, run.command)])
    scored = np.asarray(run.reference.mask)
    explained = shares(run.command, run.tool, log.dt, counts, run.error, scored)
    unknown = cast(Plant, None)
    references = jax.tree.map(lambda leaf: leaf[None], run.reference)
    scenarios = Scenarios((run.job,), (False,), (MEASURED,), references, unknown)
    counted = "tracking" if len(flags.axes) == 1 else "contour"
    machine = MachineSummary(f"machine of {flags.data.name}", "m", flags.axes, MEASURED)
    result = AuditedResult(
        machine=machine,
        controller=MEASURED,
        weights={},
        error=counted,
        contour=run.job.name,
        feed_law=MEASURED,
        samples=len(run.tool),
        preview=0,
        plants={MEASURED: RunMetrics.of(metrics, lambda values: values[0, 0])},
        read=read_of(run.job, log.dt),
        peak=peak_place(scenarios, replayed, 0, counted),
        verdict=Verdict.of([], passed="MEASURED"),
        sample_period=log.dt,
        words=[*log.words, *run.words],
        lags=[lag if np.isfinite(lag) else None for lag in explained.lags.tolist()],
        causes=cause_shares(explained, flags.axes),
    )
    folder = run_folder.create(flags.out, "audit", flags, [flags.data])
    title = f"jcontour audit: {flags.data.name}"
    save_rollouts("auto", {MEASURED: replayed}, scenarios, machine, title, folder)
    drawn = DrawnRun(MEASURED, flags.data.name, run.tool, run.command, error)
    time = log.dt * np.arange(len(run.tool))
    runs = ContourRuns(run.job.name, time, scored, run.command, flags.axes, "m", ((drawn,),))
    figures = figures_of(runs) | {"causes": causes_figure(runs, explained, result.causes)}
    for name, figure in figures.items():
        save_figure(figure, folder / f"{name}.png")
    write_result(folder, result)
    return finished(folder, result, flags, show_causes, audit_answer(result))
