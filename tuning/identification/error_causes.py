"""Causes of a measured contour error: lag, overshoot, friction, backlash, vibration, counts.

The tool of a machine is at y(t), where its control wants it at r(t). Behind the delay T that the
axes share, axis by axis and by least squares,

    y(t) = r(t - T) + o + g r - c v + sum_k a_k H_k(s) v + b p + sum_k f_k H_k(s) d + n

with zero o and scale g, v the speed of r(t - T), p its play about itself for a gap of one unit,
d = +-1 the direction in which it went last, and high-passes H_k = tau_k s / (tau_k s + 1). What is
left, n, holds vibration, a narrow band of its spectrum, and the rounding of encoders to counts.
Terms that the others make up for are left out, by backward elimination, likely ones last: a
straight piece does not tell a lag from a zero, and least squares alone would give both large shares
that cancel.

The lag of an axis, c beyond T, and what cuts curves inside are one cause: a loop with a lag does
both. What goes outside, sum_k a_k H_k(s) v against the acceleration, is overshoot. What follows a
reversal and stays until the next is backlash; what an integrator takes away in time is counted as
friction.

A cause adds a vector to y. Its part P across the path, along the contour error e, is its share

    share = mean(e' P vector) / RMS(e),    sum of all shares = RMS(e)
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import CubicSpline
from scipy.linalg import orth
from scipy.ndimage import median_filter
from scipy.signal import lfilter, welch

Kind = Literal[
    "scale",
    "lag",
    "overshoot",
    "friction",
    "backlash",
    "vibration",
    "quantisation",
    "commanded path",
    "unexplained",
]
ROUNDS = 4  # for the delay, and for the width of the gap
DECAYS = (0.004, 0.012, 0.036)  # [s] of what friction leaves behind a reversal
TRANSIENTS = (0.002, 0.006, 0.018)  # [s] of the loop, behind corners
SEGMENT = 0.5  # [s] of a spectrum of many: lines of 2 Hz
PERIODS = 4  # of a vibration in a segment, at least: 8 Hz
PROMINENT = 8.0  # times the spectrum around it
BAND = 0.15  # relative half width of the band of a vibration
MOVING = 0.05  # of the largest speed: faster at its first sample a record begins in motion
STILL = 1e-6  # [m] of travel: an axis that moves less stands still
MOVED = 5.0  # counts, beyond which an axis has turned
FINEST = 1e-8  # [m] of a count
NEEDED = 0.25  # of what all terms leave: what one has to take off, else it is left out
SMALL = 0.01  # of the error, likewise
PRICE = 0.003  # of a term's size


@dataclass(frozen=True)
class Cause:
    """What one cause adds to the place of the tool."""

    kind: Kind  # what it is
    axis: int | None  # index of the axis; None of all
    vector: Float[np.ndarray, "T m"]  # [m]
    # height of a spike at a reversal [m], gap [m], frequency of a vibration [Hz], count [m],
    # overshoot over acceleration [s^2], which is negative, relative error of the scale; zero of the
    # others
    size: float
    lasts: float = 0.0  # time until a spike has fallen to a third [s]


@dataclass(frozen=True)
class Shares:
    """Causes of a contour error, the largest share first; the last is what is unexplained."""

    causes: list[Cause]  # all of them
    rms: Float[np.ndarray, " causes"]  # share of each in the RMS contour error [m]
    peak: Float[np.ndarray, " causes"]  # in the largest [m]
    along: Float[np.ndarray, "causes T"]  # in the error of every sample, which they sum to [m]
    lags: Float[np.ndarray, " m"]  # of the axes behind the command [s]; NaN of one that rests


@dataclass(frozen=True)
class _Axis:
    """An axis behind the common delay: its lag [s], and what adds to its place (T,) [m]."""

    lag: float
    lagging: np.ndarray
    others: list[tuple[Kind, np.ndarray, float, float]]


def shares(
    command: Float[np.ndarray, "T m"],
    tool: Float[np.ndarray, "T m"],
    dt: float,
    counts: Float[np.ndarray, "2 m"],
    error_of: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    scored: Bool[np.ndarray, " T"],
) -> Shares:
    """Causes of the contour error of a record, with their shares.

    Args:
        command: where the control wants the axes [m].
        tool: where they are [m].
        dt: sample period [s].
        counts: of the encoders, and of the commands in the record (2, m) [m].
        error_of: contour errors and unit tangents (T, m) at places (T, m).
        scored: which samples count.
    """
    axes, rounded = range(command.shape[1]), np.hypot(*counts)
    error, tangent = error_of(tool)
    off = np.linalg.norm(error, axis=1)
    square = float(np.mean(off[scored] ** 2))
    least = SMALL * np.sqrt(square)
    delay, between, late, each = 0.0, 0.0, command, list[_Axis]()
    for _ in range(1 if len(axes) == 1 else ROUNDS):  # until lags lie around the delay
        late, speed = _delayed(command, dt, delay)
        each = [
            _axis(late[:, k], speed[:, k], tool[:, k], dt, float(rounded[k]), least) for k in axes
        ]
        powers, found = (speed**2).sum(axis=0), np.array([one.lag for one in each])
        between = float(powers @ np.nan_to_num(found) / max(powers.sum(), 1e-300))
        delay += between
    asked, _ = error_of(late)
    causes = [Cause("lag", None, np.stack([one.lagging for one in each], axis=1), 0.0)]
    for k, one in enumerate(each):
        for kind, values, size, lasts in one.others:
            size = float(counts[:, k].max()) if kind == "quantisation" else size
            causes.append(Cause(kind, k, np.eye(len(axes))[k] * values[:, None], size, lasts))
    parts = [_across(one.vector, tangent) for one in causes]
    causes.append(Cause("commanded path", None, asked, 0.0))
    parts.append(asked)
    causes.append(Cause("unexplained", None, error - sum(parts), 0.0))
    parts.append(causes[-1].vector)
    way = error / np.maximum(off, 1e-300)[:, None]
    along = np.stack([(part * way).sum(axis=1) for part in parts])
    rms = (along * off)[:, scored].mean(axis=1) / max(np.sqrt(square), 1e-300)
    order = [*np.argsort(-np.abs(rms[:-1]), kind="stable"), len(parts) - 1]
    worst = int(np.argmax(np.where(scored, off, 0.0)))
    lags = delay - between + np.array([one.lag for one in each])
    along = along[order]
    return Shares([causes[j] for j in order], rms[order], along[:, worst], along, lags)


def _across(vector: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Part of a vector across the path; on one axis, which is all of its path, the vector."""
    if vector.shape[1] == 1:
        return vector
    return vector - (vector * tangent).sum(axis=1, keepdims=True) * tangent


def _delayed(command: np.ndarray, dt: float, delay: float) -> tuple[np.ndarray, np.ndarray]:
    """The command some time ago and its speed; outside the record it stands."""
    time = dt * np.arange(len(command))
    spline, then = CubicSpline(time, command), np.clip(time - delay, 0.0, time[-1])
    return spline(then), spline(then, 1)


def _axis(
    place: np.ndarray, speed: np.ndarray, tool: np.ndarray, dt: float, count: float, least: float
) -> _Axis:
    """Causes on one axis, along its command behind the common delay."""
    apart = tool - place
    if np.ptp(place) < STILL:  # it has noise alone
        left = apart - apart.mean()
        return _Axis(np.nan, np.zeros(len(place)), _noise(left, dt, count))
    way = hysteresis(place, MOVED * max(count, FINEST))[1]
    transients = np.stack([high_passed(speed, tau, dt) for tau in TRANSIENTS], axis=1)
    moving = abs(speed[0]) > MOVING * np.abs(speed).max()
    if moving:  # of what was before decays something
        time = dt * np.arange(len(place))[:, None]
        transients = np.concatenate([transients, np.exp(-time / TRANSIENTS)], axis=1)
    spikes = -np.stack([high_passed(way, tau, dt) for tau in DECAYS], axis=1)
    scale = np.stack([np.ones(len(place)), place - place.mean()], axis=1)
    turns = float(way.min() < 0 < way.max())  # else neither friction nor backlash shows
    gap, bases, least = max(count, FINEST), [], max(least, count / np.sqrt(12), FINEST)
    for _ in range(ROUNDS):
        play = turns * hysteresis(place, gap)[0]
        bases = [scale, turns * spikes, play[:, None], transients, -speed[:, None]]
        b = _least_squares(np.concatenate(bases, axis=1), apart)[2 + len(DECAYS)]
        gap = max(float(b), count, FINEST)
    found = _needed(bases, apart, least)
    if found[2] < 0:  # a gap never leads
        bases[2] = 0 * bases[2]
        found = _needed(bases, apart, least)
    g, f, b, a, lag = found
    lagging, cornering = bases[4] @ lag, transients @ a
    left = apart - sum(base @ one for base, one in zip(bases, found, strict=True))
    height, lasts = _spike(f)
    others: list[tuple[Kind, np.ndarray, float, float]] = [
        ("scale", scale @ g, float(g[1]), 0.0),
        ("backlash", bases[2] @ b, float(b[0]), 0.0),
        ("friction", bases[1] @ f, height, lasts),
        *_noise(left, dt, count),
    ]
    push = np.gradient(speed, dt)
    bend = float((lagging + cornering) @ push) / max(float(push @ push), 1e-300)
    if bend > 0:
        lagging = lagging + cornering
    else:
        others = [("overshoot", cornering, bend, 0.0), *others]
    if moving:  # it shares what decays with its corners
        return _Axis(-float(lagging @ speed) / float(speed @ speed), lagging, others)
    return _Axis(float(lag[0]), lagging, others)


def hysteresis(
    place: Float[np.ndarray, " T"], gap: float
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]:
    """Way of a mass behind a gap less the place, over the gap, and the direction it last went.

    The play operator: at rest inside the gap, else half of it behind.
    """
    half, behind, way = gap / 2, float(place[0]), 0.0
    behinds, ways = np.empty(len(place)), np.empty(len(place))
    for k, x in enumerate(place.tolist()):
        if x - behind > half:
            behind, way = x - half, 1.0
        elif behind - x > half:
            behind, way = x + half, -1.0
        behinds[k], ways[k] = behind, way
    return (behinds - place) / gap, ways


def high_passed(signal: Float[np.ndarray, " T"], tau: float, dt: float) -> Float[np.ndarray, " T"]:
    """tau s / (tau s + 1) of a signal that is constant before it begins."""
    return np.asarray(lfilter([1.0, -1.0], [1.0, -np.exp(-dt / tau)], signal - signal[0]))


def _needed(bases: list[np.ndarray], apart: np.ndarray, least: float) -> list[np.ndarray]:
    """Coefficients of the bases by least squares, zero of those that the others make up for.

    One after the other goes, the first one first and the last one never, if all that went take off
    less than so much, and than `NEEDED` of what the whole set leaves. A term costs `PRICE` of its
    size: large ones that cancel do not pay.
    """
    R = np.asarray(np.linalg.qr(np.column_stack([*bases, apart]), mode="r"))
    parts = np.split(R[:, :-1], np.cumsum([base.shape[1] for base in bases])[:-1], axis=1)
    spans, wanted = [orth(part, rcond=1e-8) for part in parts], R[:, -1]

    def fitted(kept: list[int]) -> tuple[float, list[np.ndarray]]:
        A = np.concatenate([spans[one] for one in kept], axis=1)
        z = np.linalg.solve(A.T @ A + PRICE**2 * np.eye(A.shape[1]), A.T @ wanted)
        sizes = iter(np.split(z, np.cumsum([spans[one].shape[1] for one in kept])[:-1]))
        terms = [spans[k] @ next(sizes) if k in kept else 0 * wanted for k in range(len(bases))]
        found = [_least_squares(part, term) for part, term in zip(parts, terms, strict=True)]
        return float(np.linalg.norm(wanted - A @ z)), found

    kept = list(range(len(bases)))
    left, found = fitted(kept)
    most = np.hypot(left, max(NEEDED * left, least * np.sqrt(len(apart))))
    for base in range(len(bases) - 1):
        fewer = [one for one in kept if one != base]
        left, without = fitted(fewer)
        if left <= most:
            kept, found = fewer, without
    return found


def _least_squares(A: np.ndarray, right: np.ndarray) -> np.ndarray:
    scale = np.linalg.norm(A, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    return np.linalg.lstsq(A / scale, right, rcond=1e-8)[0] / scale


def _spike(f: np.ndarray) -> tuple[float, float]:
    """Height of what friction leaves behind one reversal [m], and time to a third of it [s]."""
    time = np.linspace(0.0, 5 * DECAYS[-1], 500)
    answer = np.abs(2 * np.exp(-time[:, None] / DECAYS) @ f)
    top = int(np.argmax(answer))
    below = np.flatnonzero(answer[top:] < answer[top] / 3)
    return float(answer[top]), float(time[top + below[0]]) if below.size else float(time[-1])


def _noise(
    left: np.ndarray, dt: float, count: float
) -> list[tuple[Kind, np.ndarray, float, float]]:
    """Vibration and rounding in what the motion does not explain."""
    found: list[tuple[Kind, np.ndarray, float, float]] = []
    hertz = vibration(left, dt)
    if hertz is not None:
        frequency, spectrum = np.fft.rfftfreq(len(left), dt), np.fft.rfft(left)
        inside = np.abs(frequency / hertz - 1) <= BAND
        shaken = np.fft.irfft(np.where(inside, spectrum, 0.0), len(left))
        found.append(("vibration", shaken, hertz, 0.0))
        left = left - shaken
    rounding = min(1.0, count**2 / 12 / max(float(np.var(left)), 1e-300))
    return [*found, ("quantisation", rounding * left, count, 0.0)]


def vibration(left: Float[np.ndarray, " T"], dt: float) -> float | None:
    """Frequency of the most prominent narrow band of a spectrum [Hz]; None without one."""
    rows = min(max(round(SEGMENT / dt), 2 * PERIODS), len(left))
    hertz, power = welch(left, 1 / dt, nperseg=rows)
    around = median_filter(power, size=max(len(power) // 8, 9), mode="nearest")
    slowest = PERIODS * hertz[1] * (1 - 1e-9)
    high = np.flatnonzero((hertz >= slowest) & (power > PROMINENT * around))
    return float(hertz[high[np.argmax(power[high])]]) if high.size else None
