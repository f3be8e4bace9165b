"""Comparison of contouring schemes: verdicts, tables, figures and the legends; one whole run."""

from dataclasses import replace

import numpy as np

from experiments.papers.contouring_schemes import experiment as paper
from experiments.papers.contouring_schemes.claims import claims, tables, tuning
from experiments.papers.verdicts import Verdict
from experiments.tables import Table, stored

YES, NO = Verdict.REPRODUCED, Verdict.NOT_REPRODUCED
NAMES = (
    "start",
    paper.CASCADE,
    paper.CONSTANT,
    paper.VARIABLE,
    paper.TASK_FRAME,
    paper.PRECOMPENSATION,
    paper.SHAPING,
)
GOOD = dict(zip(NAMES, (90.0, 30.0, 33.0, 20.0, 31.0, 20.0, 20.5), strict=True))  # [um]
BAD = dict(zip(NAMES, (90.0, 30.0, 33.0, 40.0, 15.0, 25.0, 50.0), strict=True))


def made_up(errors, tracking=None):
    """A result with these contour errors [um] on every contour and machine."""
    tracking, trained = tracking or dict.fromkeys(errors, 100.0), paper.training()
    contours = (*trained, *paper.held_out())
    rows = tuple(
        paper.Row(
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
        for plant in paper.MODEL_ERRORS
    )
    tuned = tuple(
        paper.TunedScheme(
            scheme=name,
            cascade={},
            gains=[],
            feasible=name != paper.TASK_FRAME,
            best_um=[3.0, 2.0, 1.0],
        )
        for name in errors
        if name != "start"
    )
    return paper.Result(False, tuned, rows)


def verdicts(result):
    return [claim.verdict for claim in claims(result)]


def test_verdicts_follow_the_numbers():
    tracking = {**dict.fromkeys(GOOD, 100.0), paper.VARIABLE: 200.0}
    assert verdicts(made_up(GOOD, tracking)) == [YES, YES, YES, NO, YES, YES]
    assert verdicts(made_up(BAD)) == [NO] * 6


def test_a_diverged_run_never_wins():
    result = made_up(GOOD)
    rows = tuple(
        replace(row, diverged=row.scheme == paper.VARIABLE and row.contour == "wave")
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
        paper.CASCADE,
        "30",
    ]
    assert rows["Training contours, nominal, stick and slip"][0][5] == "-"


def test_a_quick_run_decides_nothing():
    assert set(verdicts(replace(made_up(GOOD), quick=True))) == {Verdict.UNDECIDED}


def test_curves_are_the_best_values_of_the_descents():
    curves = tuning(made_up(GOOD)).axes[0].lines
    assert [list(line.get_ydata()) for line in curves] == [[3.0, 2.0, 1.0]] * (len(NAMES) - 1)


def test_schemes_are_those_of_the_catalogue_around_the_same_cascade():
    own = {name: scheme.names for name, scheme in paper.schemes().items()}
    assert own == {
        paper.CASCADE: (),
        paper.CONSTANT: ("cross", "cross_integral", "cross_derivative"),
        paper.VARIABLE: ("cross", "cross_integral", "cross_derivative"),
        paper.TASK_FRAME: (),
        paper.PRECOMPENSATION: ("precompensation",),
        paper.SHAPING: ("shaping",),
    }
    weights = paper.schemes()[paper.CONSTANT].around(paper.START, paper.STRONG)
    assert weights.cascade is paper.START
    np.testing.assert_allclose(weights.scheme, [30.0, 30.0, 0.1])
    assert (
        paper.TUNED_ON == tuple(paper.MODEL_ERRORS)[:2]
        and paper.MODEL_ERRORS[paper.TUNED_ON[1]].late == 1
    )


def test_runs_are_from_rest_to_rest_and_held_out_contours_are_new():
    assert not set(paper.training()) & set(paper.held_out())
    for contour in (*paper.training().values(), *paper.held_out().values()):
        reference = paper.run_along(contour)
        assert not np.any(np.asarray(reference.start_increment))
        position = np.asarray(reference.position)
        np.testing.assert_allclose(position[-1], position[-100], atol=1e-12)
