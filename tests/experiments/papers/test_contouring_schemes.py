"""Comparison of contouring schemes: verdicts, tables, figures and the legends; one whole run."""

from dataclasses import replace

import numpy as np

from experiments.papers.contouring_schemes.claims import claims, tables, tuning
from experiments.papers.contouring_schemes.experiment import (
    CASCADE,
    CONSTANT,
    MODEL_ERRORS,
    PRECOMPENSATION,
    SHAPING,
    START,
    STRONG,
    TASK_FRAME,
    TUNED_ON,
    VARIABLE,
    Result,
    Row,
    TunedScheme,
    held_out,
    run_along,
    schemes,
    training,
)
from experiments.papers.verdicts import Verdict
from experiments.tables import Table, stored

YES, NO = Verdict.REPRODUCED, Verdict.NOT_REPRODUCED
NAMES = ("start", CASCADE, CONSTANT, VARIABLE, TASK_FRAME, PRECOMPENSATION, SHAPING)
GOOD = dict(zip(NAMES, (90.0, 30.0, 33.0, 20.0, 31.0, 20.0, 20.5), strict=True))  # [um]
BAD = dict(zip(NAMES, (90.0, 30.0, 33.0, 40.0, 15.0, 25.0, 50.0), strict=True))


def made_up(errors, tracking=None):
    """A result with these contour errors [um] on every contour and machine."""
    tracking, trained = tracking or dict.fromkeys(errors, 100.0), training()
    contours = (*trained, *held_out())
    rows = tuple(
        Row(
            scheme=scheme,
            contour=contour,
            training=contour in trained,
            plant=plant,
            contour_um=error,
            peak_um=2 * error,
            tracking_um=tracking[scheme],
            current_a=1.0,
            increment_a=0.1,
            diverged=False,
            motor_um=error / 3,
        )
        for scheme, error in errors.items()
        for contour in contours
        for plant in MODEL_ERRORS
    )
    tuned = tuple(
        TunedScheme(
            scheme=name,
            cascade={},
            gains=[],
            feasible=name != TASK_FRAME,
            best_um=[3.0, 2.0, 1.0],
        )
        for name in errors
        if name != "start"
    )
    return Result(False, tuned, rows)


def verdicts(result):
    return [claim.verdict for claim in claims(result)]


def test_verdicts_follow_the_numbers():
    tracking = {**dict.fromkeys(GOOD, 100.0), VARIABLE: 200.0}
    assert verdicts(made_up(GOOD, tracking)) == [YES, YES, YES, NO, YES, YES]
    assert verdicts(made_up(BAD)) == [NO] * 6


def test_a_diverged_run_never_wins():
    result = made_up(GOOD)
    rows = tuple(
        replace(row, diverged=row.scheme == VARIABLE and row.contour == "wave")
        for row in result.rows
    )
    assert verdicts(replace(result, rows=rows))[:2] == [NO] * 2


def test_shown_with_its_rules_and_its_outcome():
    result = made_up(GOOD)
    first, *others = result.rows
    lost = replace(first, current_a=np.inf)
    parts = list(tables(replace(result, rows=(lost, *others))))
    text = "\n".join(part for part in parts if not isinstance(part, Table))
    assert "0.67 x the error of the plain cascade" in text
    assert "no gains within the limits were found for task frame" in text
    rows = {one["title"]: one["cells"] for one in stored(parts)}
    assert rows["Held-out contours, nominal, stick and slip"][1][:2] == [
        CASCADE,
        "30",
    ]
    assert rows["Training contours, nominal, stick and slip"][0][5] == "-"


def test_a_quick_run_decides_nothing():
    assert set(verdicts(replace(made_up(GOOD), quick=True))) == {Verdict.UNDECIDED}


def test_curves_are_the_best_values_of_the_descents():
    curves = tuning(made_up(GOOD)).axes[0].lines
    assert [list(line.get_ydata()) for line in curves] == [[3.0, 2.0, 1.0]] * (len(NAMES) - 1)


def test_schemes_are_those_of_the_catalogue_around_the_same_cascade():
    own = {name: scheme.names for name, scheme in schemes().items()}
    assert own == {
        CASCADE: (),
        CONSTANT: ("cross", "cross_integral", "cross_derivative"),
        VARIABLE: ("cross", "cross_integral", "cross_derivative"),
        TASK_FRAME: (),
        PRECOMPENSATION: ("precompensation",),
        SHAPING: ("shaping",),
    }
    weights = schemes()[CONSTANT].around(START, STRONG)
    assert weights.cascade is START
    np.testing.assert_allclose(weights.scheme, [30.0, 30.0, 0.1])
    assert TUNED_ON == tuple(MODEL_ERRORS)[:2] and MODEL_ERRORS[TUNED_ON[1]].late == 1


def test_runs_are_from_rest_to_rest_and_held_out_contours_are_new():
    assert not set(training()) & set(held_out())
    for contour in (*training().values(), *held_out().values()):
        reference = run_along(contour)
        assert not np.any(np.asarray(reference.start_increment))
        position = np.asarray(reference.position)
        np.testing.assert_allclose(position[-1], position[-100], atol=1e-12)
