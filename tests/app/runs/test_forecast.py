"""What is said of a long run before it begins."""

import numpy as np
import pytest

from jcontour.app.jobs.memory import BEGUN
from jcontour.app.runs.forecast import check_memory, forecast
from tests.app import small_runs
from tests.canonical import DT


def run(name, samples):
    return small_runs.job(name, np.ones(1, bool))._replace(arc=np.broadcast_to(0.0, samples))


def test_a_long_run_is_told_with_its_samples_and_a_short_one_is_not():
    (line,) = forecast(run("slow", 600_001), DT, plants=5)
    assert line.startswith("slow: 600 s of motion, 600,001 samples on 5 plants.")
    assert forecast(run("quick", 1001), DT, plants=5) == []


def test_a_run_that_the_memory_does_not_hold_is_refused():
    job = run("slow", 19_265_239)
    with pytest.raises(ValueError, match=r"slow: 19,265,239 samples .* 24 are free: give"):
        check_memory(job, 5, there=24e9)
    check_memory(job, 5, there=32e9)
    check_memory(run("quick", 1000), 5)  # asks the computer
    with pytest.raises(ValueError, match="GB of memory"):
        check_memory(run("none", 0), 5, there=BEGUN - 1)
