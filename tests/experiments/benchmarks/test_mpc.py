"""The table and the JSON of `jcontour bench mpc`; no time is asserted."""

import io
from dataclasses import astuple

import numpy as np
import pytest
from rich.console import Console

from experiments.benchmarks import mpc
from experiments.tables import show
from jcontour.qp.solvers import DAQP

ROW = mpc.StepTime("N = 7", "daqp", 12.0, 34.0, 56.0, 78.0, 9.0)


def test_a_row_says_who_was_timed_and_its_numbers():
    page = io.StringIO()
    show(Console(file=page, width=120), mpc.tables([ROW]))
    row = next(line for line in page.getvalue().splitlines() if "N = 7" in line)
    words = [word for word in row.split() if word.isascii()]
    assert words[3:] == ["daqp", "12", "34", "56", "78", "9"]


@pytest.mark.slow
def test_every_part_of_a_step_is_timed(monkeypatch):
    monkeypatch.setattr(mpc, "STEPS", 3)
    monkeypatch.setattr(mpc, "WARM", 1)
    monkeypatch.setattr(mpc, "REPEATS", 1)
    row = mpc._measured("N = 3", DAQP(), 4e-3, 3)
    assert (row.controller, row.solver) == ("N = 3", "daqp")
    numbers = np.array(astuple(row)[2:])
    assert (np.isfinite(numbers) & (numbers > 0)).all()
