"""What `jcontour trace` prints: whether the tool arrived, how far off it was, the next step."""

from pathlib import Path

import numpy as np
from rich.console import Console

from jcontour.app.designs.predictive.constrained import CHANGE, LONGEST_HORIZON
from jcontour.app.files.results.traversed_result import Asked, Traversed
from jcontour.app.files.results.verdict import Verdict, exceeded, kept_words
from jcontour.app.flags.loops import Trace
from jcontour.app.reports import tables
from jcontour.simulation.traversal import END_MARGIN

AHEAD_MS = 28.0  # that the paper's 7 steps of 4 ms look ahead
LEAST, MOST = 0.03, 5.0  # q_theta, the paper's range
FULL = 0.9  # of its limit: a control that has come so far is short of it


def show(result: Traversed, console: Console) -> None:
    """How long, how far off, and whether the limits or the solver had a say."""
    time = "none: the tool DID NOT ARRIVE at the end of the path"
    if result.arrived:
        time = f"{tables.digits(result.time_s)} s, up to {1e3 * END_MARGIN:g} mm before the end"
    lines = [
        f"{result.contour}: {result.length_mm:.4g} mm on {result.plant}, {result.steps} samples",
        *_told_of_file(result),
        f"Traversal time    {time}",
        *_told_of_end(result),
    ]
    limited = f"{100 * result.limited:.4g} % of the steps; fallback steps: {result.fallbacks}"
    lines.append(f"Limits in plan    {limited}")
    residual = f"{result.residual:.1e} of a QP (at most 1e-8 counts as solved)"
    lines.append(f"Worst residual    {residual}")
    tables.say(console, *lines)


def verdict_on(result: Traversed) -> Verdict:
    """Verdict on a run: the tool arrives at the end, within every limit of the machine."""
    against = [f"it stopped: {result.failure}"] if result.failure else []
    against += strayed(result)
    if not result.arrived and not against:
        against.append("the tool did not arrive at the end of the path")
    return Verdict.of(result.limits, against, passed=kept_words(result.limits))


def strayed(result: Traversed) -> list[str]:
    """A line where the tool is not where the controller held it to be."""
    length = f"{result.length_mm:.4g} mm"
    if result.left_mm is not None:
        off = f"{_shown(result.left_mm)} mm"
        return [f"the tool LEFT the path: it was {off} off one of {length}"]
    if result.outrun:
        came = f"{_shown(result.progress_mm)} mm of {length}, the tool {_shown(result.came_mm)} mm"
        return [f"the controller's progress LEFT THE TOOL BEHIND: it came to {came}"]
    return []


def _told_of_end(result: Traversed) -> list[str]:
    """How far the tool came, and how far off it was on the way and at the last sample."""
    if result.end_mm is None:
        return []
    errors = "none: it counts on the whole path"
    if result.rms_um is not None:
        errors = f"RMS {result.rms_um:.4g} um, peak {result.peak_um:.4g} um"
    came = f"{_shown(result.came_mm)} mm of {result.length_mm:.4g} mm along the path"
    apart = f"{_shown(result.end_mm)} mm from its end point at the last sample"
    return [
        f"Tool came         {came}; {apart}",
        f"Contour error     {errors}",
    ]


def _told_of_file(result: Traversed) -> list[str]:
    """What was read, and what of it is not kept."""
    if result.read is None:
        return []
    name = Path(result.contour).stem
    return [
        f"Read {tables.read_line(name, result.read, result.axes)}",
        *filter(None, [result.lost]),
    ]


def next_steps(result: Traversed) -> list[str]:
    """Figures in words, and the next step."""
    told = []
    if result.signals is not None:
        told.append(
            "path.png shows the tool around the path, its error magnified, and the speed there; "
            "trace.png the signals along the path."
        )
    if result.failure:
        return [*told, "Next: --fallback hold goes on where a step has no answer."]
    if not result.arrived:
        return [*told, f"Next: {advice(result)}."]
    if exceeded(result.limits):
        lower = f"--max-speed-mm-s, {tables.digits(0.5 * result.asked.max_speed_mm_s)} say"
        known = "of the machine's limits the controller knows that of the control"
        return [*told, f"Next: a lower {lower}, or less --q-theta asks less of it: {known}."]
    return [*told, "Next: --q-theta trades time for accuracy: more is faster, less is closer."]


def _shown(length_mm: float | None) -> str:
    """A length in digits down to a nanometre; rounding is none."""
    return f"{round(length_mm or 0.0, 6):.4g}"


def advice(result: Traversed) -> str:
    """What may bring a tool to the end that did not arrive, in words."""
    if result.outrun or result.left_mm is not None:
        return _closer(result.asked)
    if result.rms_um is not None:  # it was there, and does not stay
        return (
            f"a longer --horizon brakes in time, {_farther(result.asked)} say, less --q-theta is "
            f"slower, {_less(result.asked)} say; more --q-contour and --q-lag hold the tool closer"
        )
    return _faster(result)


def _closer(asked: Asked) -> str:
    """What keeps progress and tool together."""
    ways = []
    if asked.q_lag < Trace.q_lag:
        ways.append(f"--q-lag {Trace.q_lag:g} ties progress to the tool")
    if asked.horizon * asked.period_ms < AHEAD_MS:
        ways.append(f"--horizon {_farther(asked)} looks {AHEAD_MS:g} ms ahead, as in the paper")
    if not ways or asked.q_theta > MOST:
        ways.append(f"less --q-theta, {_less(asked)} say, rewards progress less than it costs")
    return "; ".join(ways)


def _faster(result: Traversed) -> str:
    """What makes a tool go on that was too slow."""
    asked = result.asked
    if asked.q_theta < LEAST:
        return f"more --q-theta rewards progress, {Trace.q_theta:g} say"
    shares = np.divide(result.control_used, result.control_limit)
    most = int(np.argmax(shares))
    if shares[most] >= FULL:
        return "a larger --max-control allows it"
    used, limit = (tables.digits(of[most]) for of in (result.control_used, result.control_limit))
    weight, usual = asked.r_control[most], CHANGE / result.control_limit[most] ** 2
    less = tables.digits(usual if weight > 1.01 * usual else 0.1 * weight)
    sight = ""
    if asked.horizon * asked.period_ms < AHEAD_MS:
        sight = f", --horizon {_farther(asked)} sees more of it"
    return (
        f"less --r-control, {less} say, lets the controls change faster{sight}: they used at most "
        f"{used} of {limit} {result.control_unit}"
    )


def _less(asked: Asked) -> str:
    return tables.digits(0.1 * asked.q_theta)


def _farther(asked: Asked) -> int:
    """Steps of a longer horizon: as far ahead in time as the paper's, or twice as far as now."""
    paper = int(np.ceil(AHEAD_MS / asked.period_ms - 1e-9))
    steps = paper if asked.horizon < paper else 2 * asked.horizon
    return min(LONGEST_HORIZON, steps)
