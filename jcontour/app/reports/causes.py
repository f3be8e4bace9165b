"""Causes of a measured error in words: what each is, its share, and what to change."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console

from jcontour.app.files.checks import ANGLE
from jcontour.app.files.results.loop_results import AuditedResult, CauseShare
from jcontour.app.plain_numbers import feed_words
from jcontour.app.reports.screen import Entry
from jcontour.app.reports.tables import digits, placed, position, say, table_of

if TYPE_CHECKING:  # signal processing takes a second to import
    from tuning.identification.error_causes import Cause, Shares

LISTED, CHANGES = 3, 2  # causes and remedies on the screen
CANCELLED = 2.0  # times the error, of what all causes add and take away
SMALL = 0.02  # of the error: a smaller cause is not on the screen
ALIKE = 0.02  # relative, of two lags
SLOW = 1e-3  # [s] of a lag that a position gain makes


def cause_shares(shares: "Shares", axes: tuple[str, ...]) -> list[CauseShare]:
    """Every cause with its share, in words."""
    rows = []
    for cause, rms, peak in zip(shares.causes, shares.rms, shares.peak, strict=True):
        axis = "" if cause.axis is None else axes[cause.axis]
        text, remedy = _words(cause, axis, shares, axes)
        row = CauseShare(
            kind=cause.kind, axis=axis, rms=float(rms), peak=float(peak), text=text, remedy=remedy
        )
        rows.append(row)
    return rows


def _words(cause: "Cause", axis: str, shares: "Shares", axes: tuple[str, ...]) -> tuple[str, str]:
    um, ms = 1e6 * cause.size, 1e3 * cause.lasts
    match cause.kind:
        case "lag":
            return _lag(shares.lags, axes)
        case "scale":
            much, far = f"{digits(100 * abs(cause.size))} %", cause.size > 0
            went = "farther than asked" if far else "too short"
            return f"scale and zero of {axis}: it goes {much} {went}", (
                f"scale of {axis} (pitch, counts per turn): {much} {'less' if far else 'more'}, "
                "and its zero"
            )
        case "overshoot":
            each = f"{digits(1e6 * abs(cause.size))} um per m/s^2 on {axis}"
            return f"overshoot in corners, {each}", (
                f"take {each} off the acceleration feedforward of {axis}, or corner with less jerk"
            )
        case "friction":
            pulse = cause.size / max(cause.lasts, 1e-6)
            return f"friction: spikes of {digits(um)} um at reversals of {axis}", (
                f"friction feedforward on {axis}: at each reversal begin with a pulse of "
                f"{feed_words(pulse)} that decays within {digits(ms)} ms"
            )
        case "backlash":
            return f"backlash of {digits(um)} um on {axis}, or friction without an integrator", (
                f"backlash compensation of {axis}: {digits(um)} um more; where its speed loop has "
                "no integrator, friction feedforward"
            )
        case "vibration":
            return f"vibration at {digits(cause.size)} Hz on {axis}", (
                f"a notch filter at {digits(cause.size)} Hz in the velocity loop of {axis}, or "
                f"less jerk; a shaper, if moves excite it"
            )
        case "quantisation":
            return f"counts of {digits(um)} um on {axis}", f"a finer encoder on {axis}"
        case "commanded path":
            return (
                "the commands themselves leave the part, or the log has few of them in its curves",
                "a smaller path tolerance of the control, and a log at a higher rate",
            )
    return "unexplained", ""


def _lag(lags: np.ndarray, axes: tuple[str, ...]) -> tuple[str, str]:
    """Lags of all axes, and which position gain to change by how much."""
    moving = [k for k in range(len(axes)) if np.isfinite(lags[k])]
    lags, axes = lags[moving], tuple(axes[k] for k in moving)
    each = ", ".join(f"{axis} {digits(1e3 * lag)} ms" for axis, lag in zip(axes, lags, strict=True))
    slow, quick = int(np.argmax(lags)), int(np.argmin(lags))
    if len(axes) == 1:
        return f"lag: {each}", f"feed the speed forward on {axes[0]}"
    more = float(lags[slow] - lags[quick])
    if more <= ALIKE * abs(lags[slow]):
        return f"lag: {each}; curves and corners are cut inside", (
            "feed the speed forward on all axes, or raise all position gains (Kv) alike"
        )
    text = f"lag that differs: {each}"
    if lags[quick] < SLOW:
        return text, f"delay the speed feedforward of {axes[quick]} by {digits(1e3 * more)} ms"
    rise = 100 * more / lags[quick]
    gains = f"from {digits(1 / lags[slow])} to {digits(1 / lags[quick])} 1/s"
    return text, f"raise the position gain (Kv) of {axes[slow]} by {digits(rise)} %, {gains}"


def audit_answer(result: AuditedResult) -> list[Entry]:
    """Entries of the screen: the error and where it is largest, causes, and what to change."""
    (metrics,) = result.plants.values()
    rms, peak = metrics.rms(result.error), metrics.peak(result.error)
    entries = [
        Entry("Error", f"{result.error} error {_um(rms)} RMS, {_um(peak)} at most, measured")
    ]
    if result.peak is not None:
        place = position(result.machine.axes, result.peak.position)
        line = "" if result.peak.line is None else f", line {result.peak.line} of the part"
        entries.append(Entry("Largest", f"at {place}, t {placed(result.peak.time)} s{line}"))
    known = [one for one in result.causes if one.kind != "unexplained"]
    shown = [one for one in known if abs(one.rms) > SMALL * rms][:LISTED]
    heading = "Causes"
    for one in shown:
        share = f"{_um(one.rms)} RMS, {_um(one.peak)} of the largest"
        entries.append(Entry(heading, f"{share}: {one.text}"))
        heading = ""
    left = rms - sum(one.rms for one in shown)
    entries.append(Entry(heading, f"{_um(left)} RMS: all else, and unexplained"))
    changes = [one.remedy for one in shown if one.remedy and one.rms > 0][:CHANGES]
    if sum(abs(one.rms) for one in known) > CANCELLED * rms:
        changes = [
            "nothing yet: causes cancel, the record is too short or too plain to tell them "
            "apart; record a longer one, from rest to rest and with reversals"
        ]
    entries += [Entry("Change", one) for one in changes]
    said = result.words[len(result.machine.axes) :]  # what is beside the names of columns
    said += [one for one in result.words[: len(result.machine.axes)] if ANGLE in one][:1]
    return [*entries, *(Entry("Note", one) for one in said)]


def show_causes(result: AuditedResult, console: Console) -> None:
    """What was read, and a table of all causes."""
    seconds = result.samples * result.sample_period
    record = f"{result.samples} samples at {1 / result.sample_period:.5g} Hz, {seconds:.4g} s"
    say(console, f"Read {result.contour}: {record}", *result.words)
    columns: dict[str, Callable[[CauseShare], str | float]] = {
        "cause": lambda one: one.text,
        "um of RMS": lambda one: 1e6 * one.rms,
        "of largest": lambda one: 1e6 * one.peak,
    }
    console.print(table_of(f"Causes of the {result.error} error", result.causes, columns))


def _um(length: float) -> str:
    return f"{1e6 * length:.3g} um"
