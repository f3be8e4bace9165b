"""What is said of a long run before it begins."""

import io
from types import SimpleNamespace
from typing import Any, cast

import pytest
from rich.console import Console

from experiments.catalogue.machines import MACHINES
from experiments.jobs.job import Pace, from_file
from experiments.jobs.memory import BEGUN
from experiments.runs.forecast import Steps, check_memory, forecast, outline


@pytest.mark.slow
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


def test_a_run_in_steps_is_outlined_before_it_begins():
    job = cast(Any, SimpleNamespace(name="part", samples=41_001))
    line = outline(job, 1e-3, 5, "8 rounds of bending")
    assert line == (
        "part: 41 s of motion, 41,001 samples on 5 plants: 8 rounds of bending; Ctrl-C ends it."
    )


def test_after_the_second_step_it_is_told_how_long_the_others_take():
    """The first one of 60 s compiles; others of 30, 20 and 20 s follow."""
    text, times = io.StringIO(), iter([0.0, 60.0, 90.0, 110.0, 130.0])
    with Console(file=text).status("running") as status:
        steps = Steps(status, "round", 4, clock=lambda: next(times))
        seen = [str(status.status)]
        for number in (1, 2, 3, 4):
            steps.done(number)
            seen.append(str(status.status))
    assert seen[:2] == ["round 1 of 4, compiling", "round 2 of 4"]
    assert seen[2:4] == ["round 3 of 4, about 60 s more", "round 4 of 4, about 20 s more"]
    assert text.getvalue() == "A round takes 30 s: about 60 s more.\n"
