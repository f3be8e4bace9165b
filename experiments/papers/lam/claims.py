"""Statements of Lam, Manzie & Good about the X-Y table, and their verdicts."""

from collections.abc import Iterator
from itertools import product

import numpy as np
from jaxtyping import Float

from experiments.papers.lam.result import Result, Trace
from experiments.papers.verdicts import Claim, verdict

SIMILAR = 1.25  # ratio of errors up to which two controllers perform similarly
MUCH_BETTER = 2.0  # ratio of errors from which one is much better
SLOWS = -0.3  # correlation of speed and curvature below which the speed clearly falls
MPCC, MPTC, PI_SLOW, PI_FAST = "MPCC 4 ms", "MPTC 4 ms", "PI 4 ms", "PI 1 ms"
CONTROLLERS = (MPCC, MPTC, PI_SLOW, PI_FAST)
FEW = 4  # curves that may break a rule which holds on the whole


def claims(result: Result) -> tuple[Claim, ...]:
    """Every statement of section 5 with what is found on all the plants."""
    return (
        _slows_in_curves(result),
        _trades_speed(result),
        _slower_is_better(result),
        _similar_at_low_speed(result),
        _better_at_high_speed(result),
        _best_everywhere(result),
    )


def curve(
    result: Result, controller: str, plant: str
) -> tuple[Float[np.ndarray, " runs"], Float[np.ndarray, " runs"]]:
    """Curve of Fig. 13: times [s], from short to long, and RMS errors [% of the largest radius].

    Runs that do not reach the end are left out.
    """
    points = [
        point
        for point in result.trade_off
        if (point.controller, point.plant) == (controller, plant) and point.finished
    ]
    points.sort(key=lambda point: point.time_s)
    times = np.array([point.time_s for point in points], float)
    errors = np.array([point.rms_percent for point in points], float)
    return times, errors


def _slows_in_curves(result: Result) -> Claim:
    correlations = [_speed_against_curvature(trace) for trace in result.traces]
    pairs = zip(correlations, result.traces, strict=True)
    words = ", ".join(f"{found:.2f} at q_theta = {trace.q_theta:g}" for found, trace in pairs)
    return Claim(
        "Fig. 10",
        "the path speed falls around the tight curves",
        f"correlation of speed and curvature {words}",
        verdict(max(correlations) < SLOWS, max(correlations) < 0),
    )


def _speed_against_curvature(trace: Trace) -> float:
    """Correlation, without the first twentieth: there the tool starts from rest."""
    start = len(trace.speed_mm_s) // 20
    curvature = np.abs(trace.curvature_per_mm)
    return float(np.corrcoef(trace.speed_mm_s[start:], curvature[start:])[0, 1])


def _trades_speed(result: Result) -> Claim:
    slow, fast = result.traces
    speeds = [float(np.mean(trace.speed_mm_s)) for trace in (slow, fast)]
    squares = [float(np.mean(np.square(trace.contour_error_um))) for trace in (slow, fast)]
    errors = np.sqrt(squares)
    words = (
        f"mean speed {speeds[0]:.0f} against {speeds[1]:.0f} mm/s, "
        f"RMS contour error {errors[0]:.1f} against {errors[1]:.1f} um"
    )
    return Claim(
        "Figs 10, 11",
        "q_theta = 0.03 traces more slowly and more accurately than q_theta = 5",
        words,
        verdict(bool(speeds[0] < speeds[1] and errors[0] < errors[1])),
    )


def _slower_is_better(result: Result) -> Claim:
    broken = []
    for controller, plant in product(CONTROLLERS, result.plants):
        _, errors = curve(result, controller, plant)
        if np.any(np.diff(errors) > 0):
            broken.append(f"{controller} on {plant}")
    words = f"fails for {'; '.join(broken)}" if broken else "holds for every controller and plant"
    return Claim(
        "Fig. 13",
        "every controller is more accurate the longer it takes",
        words,
        verdict(not broken, len(broken) < FEW),
    )


def _similar_at_low_speed(result: Result) -> Claim:
    found = list(_each_plant(result, PI_FAST, longest=True))
    similar = [1 / SIMILAR <= ratio <= SIMILAR for _, _, ratio in found]
    return Claim(
        "Fig. 13",
        "MPCC performs similarly to PI at 1 ms at low speed",
        _ratios(PI_FAST, found),
        verdict(bool(found) and all(similar), any(similar)),
    )


def _better_at_high_speed(result: Result) -> Claim:
    found = list(_each_plant(result, PI_FAST, longest=False))
    least = min((ratio for _, _, ratio in found), default=0.0)
    return Claim(
        "Fig. 13",
        "MPCC is much more accurate than PI at 1 ms at high speed",
        _ratios(PI_FAST, found),
        verdict(least >= MUCH_BETTER, least > 1),
    )


def _best_everywhere(result: Result) -> Claim:
    lost, won = [], 0
    for other, plant in product((MPTC, PI_SLOW), result.plants):
        times, ratios = _against(result, other, plant)
        won += int(np.sum(ratios > 1))
        behind = [(t, ratio) for t, ratio in zip(times, ratios, strict=True) if ratio <= 1]
        lost += [f"{other} on {plant} at {t:.2f} s ({r:.2f} x MPCC's error)" for t, r in behind]
    words = f"MPCC is ahead in {won} of {won + len(lost)} comparisons"
    if lost:
        words += f"; behind {', '.join(lost)}"
    return Claim(
        "Fig. 13",
        "at the same sample rate MPCC outperforms the others over the whole range of times",
        words,
        verdict(not lost and won > 0, won > len(lost)),
    )


def _against(
    result: Result, other: str, plant: str
) -> tuple[Float[np.ndarray, " runs"], Float[np.ndarray, " runs"]]:
    """Times of the other controller within MPCC's range, and its error over MPCC's there."""
    times, errors = curve(result, other, plant)
    mpcc_times, mpcc_errors = curve(result, MPCC, plant)
    if mpcc_times.size == 0:
        return np.zeros(0), np.zeros(0)
    inside = (times >= mpcc_times[0]) & (times <= mpcc_times[-1])
    mpcc_there = np.interp(times[inside], mpcc_times, mpcc_errors)
    return times[inside], errors[inside] / mpcc_there


def _each_plant(result: Result, other: str, longest: bool) -> Iterator[tuple[str, float, float]]:
    """Plant, longest or shortest time [s] in MPCC's range, ratio of the errors there."""
    for plant in result.plants:
        times, ratios = _against(result, other, plant)
        if times.size:
            k = int(np.argmax(times) if longest else np.argmin(times))
            yield plant, float(times[k]), float(ratios[k])


def _ratios(other: str, found: list[tuple[str, float, float]]) -> str:
    if not found:
        return f"no run of {other} within the range of MPCC's times"
    words = [f"{ratio:.2f} at {time:.2f} s ({plant})" for plant, time, ratio in found]
    return f"error of {other} over MPCC's: {', '.join(words)}"
