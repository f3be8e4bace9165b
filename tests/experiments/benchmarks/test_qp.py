"""The table and the problems of `jcontour bench qp`; no time is asserted."""

import io

import numpy as np
import pytest
from rich.console import Console

from experiments.benchmarks import qp
from experiments.tables import show
from jcontour.qp.solvers import DAQP

ROWS = [
    qp.BatchTime("at once", 128, 12.0, 34.0, 1e-9, 0),
    qp.BatchTime("daqp, one by one", 100, 9.0, None, 1e-12, 0),
]


def test_a_row_says_who_was_timed_and_its_numbers():
    page = io.StringIO()
    show(Console(file=page, width=120), qp.tables(qp.QPBench(ROWS, 0.5)))
    lines = page.getvalue().splitlines()
    assert "50 % of them at a limit" in lines[0]
    row = next(line for line in lines if "one by one" in line)
    assert row.split()[-7:] == ["one", "100", "9", "-", "90", "1e-12", "0"]


@pytest.mark.slow
def test_half_of_the_controls_are_at_a_limit_and_the_host_has_the_same_answers():
    problems, active = qp.tight(qp.random_problems(3))
    assert active == pytest.approx(0.5, abs=0.02)
    controls = np.asarray(qp._solved(problems).trajectory.stages)[:, :, qp.STATES :]
    for ours, one in zip(controls, qp.condensed(problems), strict=True):
        wanted = DAQP().solve(one).z
        np.testing.assert_allclose(ours.ravel(), wanted, rtol=0, atol=1e-5 * np.abs(wanted).max())
