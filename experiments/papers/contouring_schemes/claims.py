"""Statements of Yuan's section 2.3 about contouring schemes, our findings and the verdicts."""

import numpy as np

from experiments.papers.contouring_schemes.result import Result
from experiments.papers.contouring_schemes.runs import (
    CASCADE,
    CONSTANT,
    FEEDBACK,
    PRECOMPENSATION,
    SHAPING,
    TASK_FRAME,
    VARIABLE,
)
from experiments.papers.verdicts import Claim, Verdict, verdict

# ratio of errors up to which two schemes count as alike: what another machine or contour may turn
# round
ALIKE = 1.05


def claims(result: Result) -> tuple[Claim, ...]:
    """Every statement with what is found on the true nominal machine, on held-out contours.

    The loops have feedback alone, as in the papers of the survey.
    """
    return (
        *_cross_coupling(result),
        _task_frame(result),
        _precompensation(result),
        _shaping(result),
        _tracking(result),
    )


def _error(result: Result, scheme: str, column: str = "contour_um") -> float:
    """Mean over the held-out contours [um]."""
    return result.mean(scheme, FEEDBACK, "nominal", training=False, column=column)


def _on(result: Result, scheme: str, contour: str) -> float:
    """RMS contour error on one contour [um]."""
    return result.mean(scheme, FEEDBACK, "nominal", contour=contour)


def _cross_coupling(result: Result) -> tuple[Claim, Claim]:
    names = (CASCADE, CONSTANT, VARIABLE)
    plain, constant, variable = (_error(result, name) for name in names)
    words = (
        f"held-out curves: constant {constant / plain:.2f} x, "
        f"variable {variable / plain:.2f} x the cascade's error"
    )
    smaller = "cross-coupled control makes the contour error smaller"
    gains = "constant gains are not effective on nonlinear contours, variable ones are"
    return (
        Claim("2.3.1", smaller, words, _smaller(min(constant, variable), plain)),
        Claim("2.3.1", gains, words, _smaller(variable, constant)),
    )


def _task_frame(result: Result) -> Claim:
    task, plain = _error(result, TASK_FRAME), _error(result, CASCADE)
    words = f"{task / plain:.2f} x the cascade's error on a machine of two different axes"
    claim = "tangential-contouring control is limited where the axes differ"
    return Claim("2.3.2", claim, words, verdict(task * ALIKE > plain))


def _precompensation(result: Result) -> Claim:
    contours = ("rhombus", "circle")
    lines, circle = (_on(result, PRECOMPENSATION, c) / _on(result, VARIABLE, c) for c in contours)
    words = (
        f"error over that of cross-coupled control: {lines:.2f} on lines with corners, "
        f"{circle:.2f} on the circle"
    )
    claim = "CCPM is comparable with cross-coupled control on lines, better on circles"
    comparable = 1 / ALIKE < lines < ALIKE
    found = verdict(comparable and circle < 1, circle < min(1, lines))
    return Claim("2.3.3", claim, words, found)


def _shaping(result: Result) -> Claim:
    names = (CASCADE, SHAPING, PRECOMPENSATION)
    plain, shaped, ccpm = (_error(result, name) for name in names)
    words = f"{shaped / plain:.2f} x the cascade's error, pre-compensation {ccpm / plain:.2f} x"
    claim = "command shaping, beside the numerical control, does as well as CCPM"
    return Claim("2.3.3", claim, words, verdict(shaped < ALIKE * ccpm))


def _tracking(result: Result) -> Claim:
    """Fig. 2.10: Case II has the larger tracking error and the smaller contour error."""
    names = result.schemes
    contour = np.array([_error(result, name) for name in names])
    tracking = np.array([_error(result, name, "tracking_um") for name in names])
    better = contour[:, None] * ALIKE < contour[None, :]
    worse = tracking[:, None] > tracking[None, :] * ALIKE
    pairs = np.argwhere(better & worse)
    words = "; ".join(
        f"{names[i]} has the smaller contour error and the larger tracking error of {names[j]}"
        for i, j in pairs[:2]
    )
    words = words or "no pair of schemes where one is larger and the other smaller"
    claim = "a smaller contour error does not need smaller tracking errors"
    return Claim("2.3, Fig. 2.10", claim, words, verdict(len(pairs) > 0))


def _smaller(value: float, other: float) -> Verdict:
    return verdict(value * ALIKE < other, value < other)
