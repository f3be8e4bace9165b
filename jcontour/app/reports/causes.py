"""Causes of a measured error in words: what each is, its share, and what to change."""

import numpy as np

from jcontour.app.files.results.loop_results import AuditedResult, CauseShare
from jcontour.app.reports.tables import digits
from tuning.identification.error_causes import Cause, Shares

LISTED, SMALL = 5, 0.02  # causes in a table, and the part of the error below which none is
ALIKE = 0.02  # relative, of two lags
SLOW = 1e-3  # [s] of a lag that a position gain makes


def told(found: Shares, axes: tuple[str, ...]) -> list[CauseShare]:
    """Every cause with its share, in words."""
    rows = []
    for cause, rms, peak in zip(found.causes, found.rms, found.peak, strict=True):
        axis = "" if cause.axis is None else axes[cause.axis]
        text, remedy = _words(cause, axis, found, axes)
        row = CauseShare(
            kind=cause.kind, axis=axis, rms=float(rms), peak=float(peak), text=text, remedy=remedy
        )
        rows.append(row)
    return rows


def _words(cause: Cause, axis: str, found: Shares, axes: tuple[str, ...]) -> tuple[str, str]:
    um, ms = 1e6 * cause.size, 1e3 * cause.lasts
    match cause.kind:
        case "lag":
            return _lag(found.lags, axes)
        case "scale":
            each = f"{digits(100 * cause.size)} %"
            return f"scale and zero of {axis}: it goes {each} farther than asked", (
                f"scale of {axis} (pitch, counts per turn): {each} less, and its zero"
            )
        case "overshoot":
            each = f"{digits(1e6 * abs(cause.size))} um per m/s^2 on {axis}"
            return f"overshoot in corners, {each}", (
                f"take {each} off the acceleration feedforward of {axis}, or corner with less jerk"
            )
        case "friction":
            pulse = 1e3 * cause.size / max(cause.lasts, 1e-6)
            return f"friction: spikes of {digits(um)} um at reversals of {axis}", (
                f"friction feedforward on {axis}: at each reversal begin with a pulse of "
                f"{digits(pulse)} mm/s that decays within {digits(ms)} ms"
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
                "the commands themselves leave the part",
                "a smaller path tolerance of the control",
            )
    return "unexplained", ""


def _lag(lags: np.ndarray, axes: tuple[str, ...]) -> tuple[str, str]:
    """Lags of all axes, and which position gain to change by how much."""
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


def cause_lines(result: AuditedResult) -> list[str]:
    """A table of the causes, and what to change against the two largest."""
    error = f"{result.error} error"
    total, peak = sum(one.rms for one in result.causes), sum(one.peak for one in result.causes)
    known = [
        one for one in result.causes if one.kind != "unexplained" and abs(one.rms) > SMALL * total
    ]
    shown = known[:LISTED]
    lines = [f"{'um of RMS':>9}  {'of largest':>10}  cause of the {error}"]
    for one in shown:
        lines.append(f"{1e6 * one.rms:9.3g}  {1e6 * one.peak:10.3g}  {one.text}")
    other = [total - sum(one.rms for one in shown), peak - sum(one.peak for one in shown)]
    lines.append(f"{1e6 * other[0]:9.3g}  {1e6 * other[1]:10.3g}  all else, and unexplained")
    lines.append(f"{1e6 * total:9.3g}  {1e6 * peak:10.3g}  together")
    return [*lines, *(f"Change: {one.remedy}" for one in shown[:2] if one.remedy and one.rms > 0)]
