"""Statements of Yuan's section 2.3 about contouring schemes: verdicts, tables and figures."""

from collections.abc import Iterator
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.contouring_schemes.experiment import (
    CASCADE,
    CONSTANT,
    PRECOMPENSATION,
    SHAPING,
    TASK_FRAME,
    VARIABLE,
    Result,
)
from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.verdicts import Claim, undecided, verdict
from experiments.tables import Column, Table
from jcontour.app.reports.tables import digits

# ratio of errors up to which two schemes count as alike: what another machine or contour may turn
# round
ALIKE = 1.05
COLUMNS = {
    "RMS\ncontour um": "contour_um",
    "peak\num": "peak_um",
    "RMS at the\nmotors um": "motor_um",
    "RMS\ntracking um": "tracking_um",
    "RMS\ncurrent A": "current_a",
    "RMS\nincrement A": "increment_a",
}


def claims(result: Result) -> tuple[Claim, ...]:
    """Every statement with what is found; a quick run decides none."""
    statements = tuple(_decided(result))
    return undecided(statements) if result.quick else statements


def _decided(result: Result) -> Iterator[Claim]:
    """Judged on the true nominal machine, on held-out contours."""
    names = result.schemes
    on_nominal = partial(result.mean, plant="nominal")
    errors = {name: on_nominal(name, training=False) for name in names}  # [um]
    plain, constant, variable = errors[CASCADE], errors[CONSTANT], errors[VARIABLE]
    words = (
        f"held-out curves: constant {constant / plain:.2f} x, "
        f"variable {variable / plain:.2f} x the cascade's error"
    )
    for statement, value, other in (
        ("cross-coupled control makes the contour error smaller", min(constant, variable), plain),
        (
            "constant gains are not effective on nonlinear contours, variable ones are",
            variable,
            constant,
        ),
    ):
        yield Claim("2.3.1", statement, words, verdict(value * ALIKE < other, value < other))
    yield Claim(
        "2.3.2",
        "tangential-contouring control is limited where the axes differ",
        f"{errors[TASK_FRAME] / plain:.2f} x the cascade's error "
        "on a machine of two different axes",
        verdict(errors[TASK_FRAME] * ALIKE > plain),
    )
    lines, circle = (
        on_nominal(PRECOMPENSATION, contour=name) / on_nominal(VARIABLE, contour=name)
        for name in ("rhombus", "circle")
    )
    comparable = 1 / ALIKE < lines < ALIKE
    yield Claim(
        "2.3.3",
        "CCPM is comparable with cross-coupled control on lines, better on circles",
        f"error over that of cross-coupled control: {lines:.2f} on lines with corners, "
        f"{circle:.2f} on the circle",
        verdict(comparable and circle < 1, circle < min(1, lines)),
    )
    shaped, ccpm = errors[SHAPING], errors[PRECOMPENSATION]
    yield Claim(
        "2.3.3",
        "command shaping, beside the numerical control, does as well as CCPM",
        f"{shaped / plain:.2f} x the cascade's error, pre-compensation {ccpm / plain:.2f} x",
        verdict(shaped < ALIKE * ccpm),
    )
    # Fig. 2.10: Case II has the larger tracking error and the smaller contour error
    contour = np.array(list(errors.values()))
    tracking = np.array([on_nominal(name, column="tracking_um", training=False) for name in names])
    better = contour[:, None] * ALIKE < contour[None, :]
    worse = tracking[:, None] > tracking[None, :] * ALIKE
    pairs = np.argwhere(better & worse)
    words = "; ".join(
        f"{names[i]} has the smaller contour error and the larger tracking error of {names[j]}"
        for i, j in pairs[:2]
    )
    yield Claim(
        "2.3, Fig. 2.10",
        "a smaller contour error does not need smaller tracking errors",
        words or "no pair of schemes where one is larger and the other smaller",
        verdict(len(pairs) > 0),
    )


def tables(result: Result) -> Iterator[Table | str]:
    """Held-out and training contours, and the outcome."""
    for title, training in (("Held-out", False), ("Training", True)):
        columns: dict[str, Column] = {"scheme": str}
        for heading, column in COLUMNS.items():
            mean = partial(result.mean, plant="nominal", column=column, training=training)
            columns[heading] = lambda scheme, mean=mean: digits(mean(scheme))
        name = f"{title} contours, nominal, stick and slip"
        yield Table(name, result.different("scheme"), columns)
    plants = result.different("plant")
    errors = {
        name: [result.mean(name, plant, training=False) for plant in plants]
        for name in result.schemes
    }
    best = min(errors, key=lambda name: errors[name][0])
    yield (
        f"Held out: {best} has {errors[best][0] / errors[CASCADE][0]:.2f} x the error "
        f"of the plain cascade tuned as much; on the worst machine {max(errors[best]):.1f} "
        f"against {max(errors[CASCADE]):.1f} um"
    )
    if result.quick:
        yield "A quick run decides no statement: its budget is a fifth of the full one."
    for row in result.tuning:
        if not row.feasible:
            yield f"WARNING: no gains within the limits were found for {row.scheme}"


def tuning(result: Result) -> Figure:
    """Best feasible objective over the evaluations, those of the cascade first."""
    curves = [
        Curve(np.arange(1, len(row.best_um) + 1), row.best_um, row.scheme, {"linewidth": 1.0})
        for row in result.tuning
    ]
    y, log = "mean RMS contour error [um]", {"yscale": "log"}
    panel = Panel("Tuning on the smooth twin", "evaluations", y, curves, log)
    return drawn([panel], (6.0, 4.8))


FIGURES = {"tuning": tuning}
