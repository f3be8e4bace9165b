"""What is said of a long run before it begins."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from experiments.catalogue.machines import MACHINES
from experiments.jobs.job import Pace, from_file
from experiments.jobs.memory import BEGUN
from experiments.runs.forecast import check_memory, forecast


def test_a_long_run_is_told_with_its_samples(tmp_path):
    """A line of 10 mm at 1 mm/min takes 600 s, and a hundredth of a second to start and stop."""
    path = tmp_path / "slow.ngc"
    path.write_text("G21 G1 X10 F1\n")
    machine = MACHINES["bridgeport"]()
    job = from_file(path, Pace(machine, None, None))
    (line,) = forecast(job, machine.model.dt, plants=5)
    assert line.startswith(f"slow: 600 s of motion, {job.samples:,} samples on 5 plants.")


def test_nothing_is_said_of_a_short_run(tmp_path):
    path = tmp_path / "quick.ngc"
    path.write_text("G21 G1 X10 F600\n")
    machine = MACHINES["bridgeport"]()
    assert forecast(from_file(path, Pace(machine, None, None)), machine.model.dt, 5) == []


def test_a_run_that_the_memory_does_not_hold_is_refused():
    job = cast(Any, SimpleNamespace(name="slow", samples=19_265_239))
    with pytest.raises(ValueError, match=r"slow: 19,265,239 samples .* 24 are free: give"):
        check_memory(job, 5, there=24e9)
    check_memory(job, 5, there=32e9)
    check_memory(cast(Any, SimpleNamespace(name="quick", samples=1000)), 5)  # asks the computer
    with pytest.raises(ValueError, match="GB of memory"):
        check_memory(cast(Any, SimpleNamespace(name="none", samples=0)), 5, there=BEGUN - 1)
