"""What Yuan's section 2.3 says about the schemes, what the simulation says, and the verdict, from the numbers of a run."""

from collections.abc import Callable
from typing import Any

import numpy as np

from experiments.papers.contouring_schemes.runs import CASCADE, FEEDBACK
from experiments.papers.verdicts import Verdict

Claim = dict[str, str]  # item, claim, finding, verdict
Error = Callable[..., float]  # (scheme, restrictions) -> RMS contour error [um]
# ratio of errors up to which two schemes count as alike: what another machine or contour may turn
# round
ALIKE = 1.05
CONSTANT, VARIABLE, TASK = "cross-coupled, constant", "cross-coupled, variable", "task frame"
CCPM, CPSCS = "pre-compensation", "command shaping"


def mean(summary: dict[str, Any], scheme: str, column: str, **where: Any) -> float:
    """Mean of a column over the rows of a scheme that have these entries; infinite when one of them diverged, or has no such number."""
    rows = [
        r
        for r in summary["rows"]
        if r["scheme"] == scheme and all(r[key] == value for key, value in where.items())
    ]
    lost = any(r["diverged"] or r[column] is None for r in rows)
    return float("inf") if lost else float(np.mean([r[column] for r in rows]))


def claims(summary: dict[str, Any]) -> list[Claim]:
    """Every statement with what is found on the true nominal machine under feedback alone, as in the papers of the survey."""

    def error(scheme: str, column: str = "contour_um", **where: Any) -> float:
        return mean(
            summary,
            scheme,
            column,
            loops=FEEDBACK,
            plant="nominal",
            **(where or {"training": False}),
        )

    plain, constant, variable, task, shaped, ccpm = (
        error(name) for name in (CASCADE, CONSTANT, VARIABLE, TASK, CPSCS, CCPM)
    )
    curves = f"held-out curves: constant {constant / plain:.2f} x, variable {variable / plain:.2f} x the cascade's error"
    unlike = f"{task / plain:.2f} x the cascade's error on a machine of two different axes"
    shaping = f"{shaped / plain:.2f} x the cascade's error, pre-compensation {ccpm / plain:.2f} x"
    return [
        _claim(
            "2.3.1",
            "cross-coupled control makes the contour error smaller",
            curves,
            _smaller(min(constant, variable), plain),
        ),
        _claim(
            "2.3.1",
            "constant gains are not effective on nonlinear contours, variable ones are",
            curves,
            _smaller(variable, constant),
        ),
        _claim(
            "2.3.2",
            "tangential-contouring control is limited where the axes differ",
            unlike,
            _verdict(task * ALIKE > plain),
        ),
        _precompensation(error),
        _claim(
            "2.3.3",
            "command shaping, beside the numerical control, does as well as CCPM",
            shaping,
            _verdict(shaped < ALIKE * ccpm),
        ),
        _tracking(list(dict.fromkeys(row["scheme"] for row in summary["tuning"])), error),
    ]


def _precompensation(error: Error) -> Claim:
    ratios = [error(CCPM, contour=c) / error(VARIABLE, contour=c) for c in ("rhombus", "circle")]
    words = f"error over that of cross-coupled control: {ratios[0]:.2f} on lines with corners, {ratios[1]:.2f} on the circle"
    comparable = 1 / ALIKE < ratios[0] < ALIKE
    claim = "CCPM is comparable with cross-coupled control on lines, better on circles"
    return _claim(
        "2.3.3", claim, words, _verdict(comparable and ratios[1] < 1, ratios[1] < min(1, ratios[0]))
    )


def _tracking(names: list[str], error: Error) -> Claim:
    """Fig. 2.10: Case II has the larger tracking error and the smaller contour error."""
    errors = np.array([[error(name), error(name, "tracking_um")] for name in names])
    better, worse = (
        errors[:, None, 0] * ALIKE < errors[None, :, 0],
        errors[:, None, 1] > errors[None, :, 1] * ALIKE,
    )
    pairs = np.argwhere(better & worse)
    words = "; ".join(
        f"{names[i]} has the smaller contour error and the larger tracking error of {names[j]}"
        for i, j in pairs[:2]
    )
    claim = "a smaller contour error does not need smaller tracking errors"
    words = words or "no pair of schemes where one is larger and the other smaller"
    return _claim("2.3, Fig. 2.10", claim, words, _verdict(len(pairs) > 0))


def _claim(item: str, claim: str, finding: str, verdict: Verdict) -> Claim:
    return {"item": item, "claim": claim, "finding": finding, "verdict": verdict.value}


def _smaller(value: float, other: float) -> Verdict:
    return _verdict(value * ALIKE < other, value < other)


def _verdict(holds: bool, partly: bool = False) -> Verdict:
    return (
        Verdict.REPRODUCED if holds else Verdict.SAME_ORDERING if partly else Verdict.NOT_REPRODUCED
    )
