"""What Lam says about contouring control of the X-Y table, what the simulation says, and the verdict, from the numbers of a run."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from experiments.papers.verdicts import Verdict

Claim = dict[str, str]  # item, claim, finding, verdict
SIMILAR = 1.25  # ratio of errors up to which two controllers perform similarly
MUCH_BETTER = 2.0  # ratio of errors from which one is much better
MPCC, MPTC, PI_SLOW, PI_FAST = "MPCC 4 ms", "MPTC 4 ms", "PI 4 ms", "PI 1 ms"


def claims(summary: dict[str, Any]) -> list[Claim]:
    """Every statement of section 5 with what is found on all the plants."""
    return [
        _claim(
            "Fig. 10", "the path speed falls around the tight curves", *_slows_in_curves(summary)
        ),
        _claim(
            "Figs 10, 11",
            "q_theta = 0.03 traces more slowly and more accurately than q_theta = 5",
            *_trades_speed(summary),
        ),
        _claim(
            "Fig. 13",
            "every controller is more accurate the longer it takes",
            *_slower_is_better(summary),
        ),
        _claim(
            "Fig. 13",
            "MPCC performs similarly to PI at 1 ms at low speed",
            *_similar_at_low_speed(summary),
        ),
        _claim(
            "Fig. 13",
            "MPCC is much more accurate than PI at 1 ms at high speed",
            *_better_at_high_speed(summary),
        ),
        _claim(
            "Fig. 13",
            "at the same sample rate MPCC outperforms the others over the whole range of times",
            *_best_everywhere(summary),
        ),
    ]


def curve(summary: dict[str, Any], controller: str, plant: str) -> tuple[np.ndarray, np.ndarray]:
    """Traversal times [s], from short to long, and RMS errors [% of the largest radius] of the runs that reached the end."""
    rows = [
        r
        for r in summary["trade_off"]
        if (r["controller"], r["plant"]) == (controller, plant) and r["finished"]
    ]
    rows = sorted(rows, key=lambda row: row["time_s"])
    return np.array([row["time_s"] for row in rows]), np.array([row["rms_percent"] for row in rows])


def _claim(item: str, claim: str, finding: str, verdict: Verdict) -> Claim:
    return {"item": item, "claim": claim, "finding": finding, "verdict": verdict.value}


def _slows_in_curves(summary: dict[str, Any]) -> tuple[str, Verdict]:
    correlations = []
    for trace in summary["traces"]:
        moving = slice(
            len(trace["speed_mm_s"]) // 20, None
        )  # the first twentieth is the start from rest
        speed, bend = (
            np.array(trace["speed_mm_s"])[moving],
            np.abs(trace["curvature_per_mm"])[moving],
        )
        correlations.append(float(np.corrcoef(speed, bend)[0, 1]))
    words = ", ".join(
        f"{c:.2f} at q_theta = {t['q_theta']:g}"
        for c, t in zip(correlations, summary["traces"], strict=True)
    )
    return f"correlation of speed and curvature {words}", _verdict(
        max(correlations) < -0.3, max(correlations) < 0
    )


def _trades_speed(summary: dict[str, Any]) -> tuple[str, Verdict]:
    slow, fast = summary["traces"]
    found = [
        (float(np.mean(t["speed_mm_s"])), float(np.sqrt(np.mean(np.square(t["contour_error_um"])))))
        for t in (slow, fast)
    ]
    words = f"mean speed {found[0][0]:.0f} against {found[1][0]:.0f} mm/s, RMS contour error {found[0][1]:.1f} against {found[1][1]:.1f} um"
    return words, _verdict(found[0][0] < found[1][0] and found[0][1] < found[1][1])


def _slower_is_better(summary: dict[str, Any]) -> tuple[str, Verdict]:
    broken = []
    for controller in (MPCC, MPTC, PI_SLOW, PI_FAST):
        for plant in summary["plants"]:
            _, error = curve(summary, controller, plant)
            if np.any(np.diff(error) > 0):
                broken.append(f"{controller} on {plant}")
    words = f"fails for {'; '.join(broken)}" if broken else "holds for every controller and plant"
    return words, _verdict(not broken, len(broken) < 4)


def _against(summary: dict[str, Any], other: str, plant: str) -> tuple[np.ndarray, np.ndarray]:
    """Times of the other controller within MPCC's range, and its error over MPCC's there."""
    times, errors = curve(summary, other, plant)
    own_times, own_errors = curve(summary, MPCC, plant)
    if own_times.size == 0:
        return np.zeros(0), np.zeros(0)
    inside = (times >= own_times[0]) & (times <= own_times[-1])
    return times[inside], errors[inside] / np.interp(times[inside], own_times, own_errors)


def _each_plant(
    summary: dict[str, Any], other: str, longest: bool
) -> Iterator[tuple[str, float, float]]:
    for plant in summary["plants"]:
        times, ratios = _against(summary, other, plant)
        if times.size:
            k = int(np.argmax(times) if longest else np.argmin(times))
            yield plant, float(times[k]), float(ratios[k])


def _similar_at_low_speed(summary: dict[str, Any]) -> tuple[str, Verdict]:
    found = list(_each_plant(summary, PI_FAST, longest=True))
    similar = [1 / SIMILAR <= ratio <= SIMILAR for _, _, ratio in found]
    return _ratios("PI 1 ms", found), _verdict(bool(found) and all(similar), any(similar))


def _better_at_high_speed(summary: dict[str, Any]) -> tuple[str, Verdict]:
    found = list(_each_plant(summary, PI_FAST, longest=False))
    ratios = [ratio for _, _, ratio in found]
    return _ratios("PI 1 ms", found), _verdict(
        bool(found) and min(ratios) >= MUCH_BETTER, bool(found) and min(ratios) > 1
    )


def _best_everywhere(summary: dict[str, Any]) -> tuple[str, Verdict]:
    lost, won = [], 0
    for other in (MPTC, PI_SLOW):
        for plant in summary["plants"]:
            times, ratios = _against(summary, other, plant)
            won += int(np.sum(ratios > 1))
            lost += [
                f"{other} on {plant} at {t:.2f} s ({ratio:.2f} x MPCC's error)"
                for t, ratio in zip(times, ratios, strict=True)
                if ratio <= 1
            ]
    words = f"MPCC is ahead in {won} of {won + len(lost)} comparisons" + (
        f"; behind {', '.join(lost)}" if lost else ""
    )
    return words, _verdict(not lost and won > 0, won > len(lost))


def _ratios(other: str, found: list[tuple[str, float, float]]) -> str:
    if not found:
        return f"no run of {other} within the range of MPCC's times"
    return f"error of {other} over MPCC's: " + ", ".join(
        f"{ratio:.2f} at {time:.2f} s ({plant})" for plant, time, ratio in found
    )


def _verdict(holds: bool, partly: bool = False) -> Verdict:
    return (
        Verdict.REPRODUCED if holds else Verdict.SAME_ORDERING if partly else Verdict.NOT_REPRODUCED
    )
