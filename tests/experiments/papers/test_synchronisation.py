"""Tomizuka's paper: responses against reference numbers, verdicts against made-up runs."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.papers.synchronisation import experiment as paper
from experiments.papers.synchronisation.claims import FIGURES, claims
from experiments.papers.verdicts import Verdict
from tests.reference_data import numbers_of

YES, PARTLY, NO = Verdict.REPRODUCED, Verdict.IN_PART, Verdict.NOT_REPRODUCED
ORDER = Verdict.SAME_ORDERING
REFERENCE = numbers_of("adaptive/synchronisation")
NAMES = {paper.NOMINAL: "sync_nominal", paper.WEAK: "sync_low_kc"}


@pytest.fixture(scope="module")
def result():
    return paper.run()


def wanted_rows():
    for name, key in NAMES.items():
        for row in REFERENCE[key]["continuous"]:
            yield name, paper.CONTINUOUS, row, 1e-9
        for sampled in REFERENCE[key]["discrete"]:
            for row in sampled["rows"]:
                yield name, 1e3 * sampled["T_s"], row, 1e-11


def test_responses_are_those_of_the_reference(result):
    compared = 0
    for name, period, row, rounding in wanted_rows():
        if row["beta"] not in paper.BETAS.get((name, period), ()):
            continue
        response, compared = result.row(name, period, row["beta"]), compared + 1
        if row["peak_sync"] == "diverged":
            assert response.diverged
            continue
        for column in ("peak_sync", "iae_sync", "peak_e1", "peak_e2"):
            np.testing.assert_allclose(getattr(response, column), row[column], 1e-8, rounding)
        final = abs(response.e1[-1] - response.e2[-1])
        np.testing.assert_allclose(final, row["final_sync"], 1e-8, rounding)
    assert compared >= 20


def test_bounds_are_those_of_the_reference(result):
    for name, key in NAMES.items():
        for sampled in REFERENCE[key]["discrete"]:
            bound = result.bound(name, 1e3 * sampled["T_s"])
            assert -1e-9 < 1 - bound.proven / sampled["beta_limit_spr"] < 1e-4  # it is a proof
            assert bound.exact == pytest.approx(sampled["beta_limit_lti"], rel=1e-8)
            assert bound.continuous is None and REFERENCE[key]["beta_limit_eq9"] == "unbounded"


def test_every_statement_has_its_verdict(result):
    assert [claim.verdict for claim in claims(result)] == [*[YES] * 7, ORDER, *[YES] * 3]


def changed(result, plant, period, beta, **values):
    """The result with one row changed, its statements judged anew."""
    old = result.row(plant, period, beta)
    rows = [replace(row, **values) if row is old else row for row in result.rows]
    return [claim.verdict for claim in claims(replace(result, rows=tuple(rows)))]


@pytest.mark.parametrize(
    ("place", "change", "number", "verdict"),
    [
        ((paper.NOMINAL, paper.CONTINUOUS, 0.0), {"peak_e1": 0.1}, 0, NO),
        ((paper.NOMINAL, paper.CONTINUOUS, 5.0), {"iae_sync": 0.07}, 1, NO),
        ((paper.NOMINAL, paper.CONTINUOUS, 2.0), {"peak_sync": 0.6}, 2, PARTLY),
        ((paper.NOMINAL, paper.CONTINUOUS, 10.0), {"peak_sync": 1.0}, 2, NO),
        ((paper.NOMINAL, paper.FAST, 10.0), {"peak_sync": 0.5}, 6, NO),
        ((paper.NOMINAL, paper.SLOW, 3.0), {"turns": 99}, 7, PARTLY),
    ],
)
def test_verdicts_follow_the_numbers(result, place, change, number, verdict):
    assert changed(result, *place, **change)[number] is verdict


@pytest.mark.parametrize(
    ("exact", "verdict"),
    [(2.9, NO), (3.1, ORDER), (3.9, ORDER), (4.1, YES), (4.3, YES), (4.5, PARTLY), (9.0, PARTLY)],
)
def test_a_loop_near_instability_is_stable(result, exact, verdict):
    """Of a paper whose loop rings at 4, one that is unstable there has the order alone."""
    bounds = [
        replace(row, exact=exact)
        if (row.plant, row.period_ms) == (paper.NOMINAL, paper.SLOW)
        else row
        for row in result.bounds
    ]
    assert tuple(claims(replace(result, bounds=tuple(bounds))))[7].verdict is verdict


def test_what_our_plant_was_chosen_for_is_told(result):
    chosen = [claim.item for claim in claims(result) if "our plant was chosen" in claim.finding]
    assert chosen == ["after Fig. 11", "Figs 12-14"]


def test_a_bound_that_proves_too_much_is_no_proof(result):
    bounds = [replace(row, proven=2 * row.exact) for row in result.bounds]
    assert tuple(claims(replace(result, bounds=tuple(bounds))))[8].verdict is NO


def test_unequal_axes_have_a_bound_in_continuous_time(result):
    bound = result.bound(paper.UNEQUAL, paper.FAST).continuous
    assert bound is not None and bound > 0
    assert not any(row.diverged for row in result.rows if row.plant == paper.UNEQUAL)


@pytest.mark.parametrize(
    ("signal", "count"), [([1.0, -1.0, 1.0], 2), ([1.0, 1e-9, -1e-9, 2.0], 0), ([0.0, 0.0], 0)]
)
def test_turns(signal, count):
    assert paper.turns(np.array(signal)) == count


def test_figures_show_the_numbers(result):
    shown = ((paper.CONTINUOUS, 5.0), (paper.FAST, 2.0), (paper.SLOW, 3.0))
    *responses, companions = FIGURES.values()
    moving, tool = companions(result).axes
    np.testing.assert_array_equal(moving.lines[1].get_ydata(), result.schedule.slow)
    np.testing.assert_array_equal(tool.lines[0].get_ydata(), 1e3 * result.cycles.light)
    for figure, (period, beta) in zip(responses, shown, strict=True):
        panels = figure(result).axes
        row = result.row(paper.NOMINAL, period, beta)
        np.testing.assert_array_equal(panels[1].lines[1].get_ydata(), row.e2)
        assert len(panels[2].lines) == 5
