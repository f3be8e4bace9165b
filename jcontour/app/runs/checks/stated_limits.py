"""Every limit that the machine or the flags of a tuning run state, with what a loop reaches.

The tuner keeps its bounds on a smooth twin along the training contours, with --nominal-only on one
plant. Here the loop runs on the whole family with all effects.
"""

from collections.abc import Iterator

import numpy as np

from jcontour.analysis.uncertain_loops import BORNE
from jcontour.app.files.results.run_metrics import METRICS
from jcontour.app.files.results.tuned_result import PathMargins, RobustTest, Standstill
from jcontour.app.files.results.verdict import ROUNDING, LimitCheck
from jcontour.app.jobs.replays import Replay
from jcontour.app.runs.checks.machine_limits import OVERSHOOT, machine_limits
from jcontour.app.runs.tuning.limits import AT_REST, LIMITS
from jcontour.app.runs.tuning.problem import TuningRun
from tuning.objectives import COUNT_NOISE


def stated_limits(
    run: TuningRun, replay: Replay, margins: PathMargins, rest: Standstill | None
) -> list[LimitCheck]:
    """Limits of the machine, then those of the flags."""
    return [
        *machine_limits(replay, run.scenarios, run.machine),
        *_metrics(run, replay),
        *_loops(run, margins),
        *_standstill(run, rest),
    ]


def family_limits(robust: RobustTest | None) -> list[LimitCheck]:
    """Limits of the machine at the corners of the family and at random within it, as shares."""
    if robust is None:
        return []
    return [
        LimitCheck(
            name=f"largest share of the limit of {name.replace('increment', 'control increment')}",
            value=used,
            allowed=1.0,
            member=robust.users.get(name, ""),
            slack=OVERSHOOT.get(name, ROUNDING),
        )
        for name, used in robust.uses.items()
    ]


def _metrics(run: TuningRun, replay: Replay) -> Iterator[LimitCheck]:
    """Limits on errors and controls along the training contours."""
    flags, unit = run.flags, run.machine.control_unit
    stated = [metric for flag, metric in LIMITS.items() if getattr(flags, flag)]
    if flags.max_effort is not None and "rms_control" not in stated:
        stated.append("rms_control")
    training = np.flatnonzero(run.scenarios.training)
    for name in stated:
        metric = METRICS[name]
        values = np.asarray(getattr(replay.metrics, name))[training]
        values = np.where(np.isfinite(values), values, np.inf)
        contour, plant = np.unravel_index(np.argmax(values), values.shape)
        yield LimitCheck(
            name=metric.words,
            value=metric.factor * float(values[contour, plant]),
            allowed=metric.factor * run.limits[name],
            unit=metric.shown(unit),
            member=f"{run.scenarios.jobs[training[contour]].name}, {run.scenarios.plants[plant]}",
        )


def _loops(run: TuningRun, margins: PathMargins) -> Iterator[LimitCheck]:
    """Limits on the frozen loops of the family; an unstable loop has no peak."""
    bound = run.flags.max_sensitivity
    if bound is not None:
        peak = np.inf if margins.sensitivity is None else margins.sensitivity
        yield LimitCheck(name="peak sensitivity Ms", value=peak, allowed=bound, member="family")
        if margins.measured is not None:
            on = "measured response"
            yield LimitCheck(
                name=f"Ms on the {on}", value=margins.measured, allowed=bound, member=on
            )
    if run.machine.response_uncertainty is not None:
        used = np.inf if margins.uncertainty is None else margins.uncertainty
        yield LimitCheck(name="unknown response", value=used, allowed=BORNE, member="family")


def _standstill(run: TuningRun, rest: Standstill | None) -> Iterator[LimitCheck]:
    """The control that encoder counts cause while the tool is held.

    The search takes their rounding for white noise; at rest it hardly changes between samples.
    """
    searched = run.limits.get(COUNT_NOISE)
    if rest is None or searched is None:
        return
    yield LimitCheck(
        name="RMS control by encoder counts at rest",
        value=rest.rms_control,
        allowed=searched / AT_REST,
        unit=run.machine.control_unit,
        member="family, held between two counts",
    )
