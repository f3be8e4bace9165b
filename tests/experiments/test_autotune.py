"""What `jcontour tune` warns of."""

import numpy as np
import pytest

from experiments.autotune import run_warnings
from tuning.tune import Tuned

FOUND = Tuned({}, metrics=None, feasible=True, violation=0.0, diverged_points=0, diverged_starts=0, history=[])  # type: ignore[arg-type]


def margins(radius=0.99, delay=2, at_limit=0):
    return {"largest_frozen_spectral_radius": radius, "delay_samples": delay, "probes_at_limit": at_limit}


@pytest.mark.parametrize(("delay", "unknown", "warned"), [(2, 2, False), (1, 2, True), (0, 1, True), (0, 0, False)])
def test_a_loop_that_does_not_bear_the_delay_of_its_machine(delay, unknown, warned):
    lines = run_warnings(FOUND, margins(delay=delay), unknown)
    assert lines == [] if not warned else len(lines) == 1 and lines[0].startswith(f"{delay + 1} sample") and "ring" in lines[0]


def test_an_unstable_loop_is_said_once():
    assert run_warnings(FOUND, margins(radius=1.1, delay=-1), 2) == ["a frozen loop along the training paths is unstable"]


def test_limits_are_counted_and_missed_ones_named():
    assert "leave out 3 points" in run_warnings(FOUND, margins(at_limit=3), 0)[0]
    missed = FOUND._replace(feasible=False, violation=float(np.log(1.02)))
    assert run_warnings(missed, margins(), 0) == ["no feasible point was found; these weights exceed a limit by 2 %"]
