"""Warnings of `jcontour tune`: what to know of a run before trusting its weights."""

from collections.abc import Sequence

import numpy as np

from jcontour.app.files.results.tuned_result import PathMargins
from jcontour.app.jobs.replays import Replay, Scenarios
from jcontour.app.runs.checks.arrival import arrival_warnings
from jcontour.app.runs.checks.between_samples import swing_warnings
from jcontour.app.runs.checks.lost_numbers import lost_at_start
from jcontour.app.runs.checks.machine_limits import drives_at_limits_in_rapids
from jcontour.app.runs.checks.planned_limits import limits_exceeded_by_plan
from jcontour.app.runs.tuning.problem import TuningRun
from tuning.tune import Tuned

MUCH_LAG = 5.0  # times the tracking error of the start, from which on there is a warning
OPEN = "a control is at its limit, or has a gain of zero, and the loop is open"


def run_warnings(
    run: TuningRun, tuned: Tuned, margins: PathMargins, replays: dict[str, Replay]
) -> list[str]:
    """All warnings, one line each; `replays` are those of start and tuned weights."""
    found = replays["tuned"]
    lines = search_warnings(tuned)
    if tuned.stabilised:
        lines += [f"with the start, {line}" for line in lost_at_start(run)]
    if run.design.learns:
        lines.append(
            "the controller learns while it runs: its margins are those of the loop that it begins "
            "with"
        )
    lines += run.machine.remarks
    lines += margin_warnings(margins, run.machine.unknown_delay, run.flags.min_delay_margin)
    longest = max(job.samples for job in run.scenarios.jobs)
    lines += slow_warnings(margins, longest, run.machine.model.dt)
    lines += limits_exceeded_by_plan(run.scenarios, run.machine)
    lines += swing_warnings(found, run.scenarios, run.machine)
    lines += arrival_warnings(found, run.scenarios)
    lines += drives_at_limits_in_rapids(found, run.scenarios, run.machine)
    if run.machine.error == "contour":  # the tracking error itself is tuned and shown otherwise
        lines += lag_warnings(replays, run.scenarios)
    return lines


def search_warnings(tuned: Tuned) -> list[str]:
    """Points that the tuner did not find, or had to reject."""
    lines = []
    if tuned.stabilised:
        lines.append("the start was unstable: the tuner first made every loop stable")
    if not tuned.stationary:
        lines.append(
            "the search ended before the gain that it sees was used up: --steps 60, or "
            "--every-start, may find better weights"
        )
    if tuned.diverged_points:
        points = f"{tuned.diverged_points} of {len(tuned.history)} evaluated points"
        lines.append(f"{points} had a diverging plant and were rejected")
    if tuned.diverged_starts:
        lines.append(
            f"{tuned.diverged_starts} descents could not begin because their start diverges"
        )
    return lines


def idle_warnings(names: Sequence[str]) -> list[str]:
    """Weights without any effect on the runs."""
    if not names:
        return []
    have, are = ("has", "is") if len(names) == 1 else ("have", "are")
    return [
        f"{', '.join(names)} {have} no effect on these runs and {are} left at the start: does the "
        "controller read it?"
    ]


def margin_warnings(margins: PathMargins, unknown_delay: int, asked: int = 0) -> list[str]:
    """Loops that are open or unstable, or that a little more delay makes unstable.

    Args:
        margins: of the tuned loops.
        unknown_delay: that the machine may have [samples].
        asked: delay margin that the flags ask for [samples]: losing it is a reason, no warning.
    """
    lines = []
    if margins.contours_without_margins:
        where = f"every probed point of {', '.join(margins.contours_without_margins)}"
        lines.append(f"there are no margins: at {where} {OPEN}")
    elif margins.spectral_radius >= 1:
        lines.append("with its gains frozen at a point of the training paths the loop is unstable")
    elif margins.delay_samples < unknown_delay:
        late = f"{margins.delay_samples + 1} sample{'s' if margins.delay_samples else ''} late"
        lines.append(
            f"{late}, as this machine may be, the loop frozen at a point of the training paths is "
            "unstable: longer runs may ring"
        )
    elif margins.delay_samples == 0 and not asked:
        lines.append(
            "one more sample of delay makes the loop unstable: --min-delay-margin 1 keeps it from "
            "that"
        )
    if margins.probes_left_out:
        points = (
            f"{margins.probes_left_out} probed point{'s' if margins.probes_left_out > 1 else ''}"
        )
        lines.append(f"margins leave out {points} where {OPEN}")
    return lines


def slow_warnings(margins: PathMargins, longest: int, dt: float) -> list[str]:
    """A mode of the loop that lasts longer than any run: no run shows what it does.

    It may be that of an observer that finds a load, or of an integral part, as well as the tool's.

    Args:
        margins: of the tuned loops.
        longest: samples of the longest contour.
        dt: sample period [s].
    """
    if not (margins.stable and margins.spectral_radius > np.exp(-1 / longest)):
        return []
    lasts = -1 / np.log(margins.spectral_radius)
    return [
        f"the slowest mode of the loop dies out to a third in {lasts:.4g} samples "
        f"({1e3 * dt * lasts:.3g} ms), the longest contour has {longest}: what a constant load "
        "does may last longer than these runs show; a longer part shows it"
    ]


def lag_warnings(replays: dict[str, Replay], scenarios: Scenarios) -> list[str]:
    """Tell where the tuned tool lags far more than before.

    Contour error alone is also small for a tool that hardly moves.
    """
    before = 1e6 * np.asarray(replays["start"].metrics.rms_tracking_error).max(axis=1)
    after = 1e6 * np.asarray(replays["tuned"].metrics.rms_tracking_error).max(axis=1)
    worst = int(np.argmax(after / before))
    if after[worst] < MUCH_LAG * before[worst]:
        return []
    lag = f"{after[worst]:.4g} um behind on {scenarios.jobs[worst].name}"
    return [
        f"the tool lags {lag} (start: {before[worst]:.4g} um): contour error alone does not mind; "
        "limit it with --max-tracking-error-um"
    ]
