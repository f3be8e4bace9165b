"""Refusals of a bounded MPC in the names and units of the machine."""

import numpy as np

from jcontour.app.designs.bounded import no_answer
from jcontour.app.machines.machine import MachineLimits
from jcontour.sets.least_peaks import NoResponse
from tests.app import small_runs

LIMITS = MachineLimits(control=np.array([400.0, 300.0]), speed=np.array([0.3, 0.2]))
MACHINE = small_runs.machine(LIMITS, control_unit="V", control_noise=15.0, friction=None)


def test_limits_are_told_by_axis_and_input_with_units():
    needed, asked = {"speed 2": 0.534529, "control 1": 812.0}, {"speed 2": 0.16, "control 1": 390.0}
    told = no_answer(MACHINE, 15.0, NoResponse("unread", needed, asked))
    assert told == (
        "force: 15 V on every control (5 % of the smallest control limit by default; --force sets "
        "it) leaves nothing to answer it with: speed of Y: 0.16 m/s is left of the limit of "
        "0.2 m/s, 0.535 m/s would do; control of input 1: 390 V is left of the limit of 400 V, "
        "812 V would do"
    )


def test_one_input_has_no_number():
    told = no_answer(MACHINE, 30.0, NoResponse("unread", {"control": 500.0}, {"control": 400.0}))
    assert "(10 % of the smallest control limit; --force sets it)" in told
    assert "control of input 1: 400 V is left" in told


def test_other_reasons_are_told_as_they_are_but_for_the_axis():
    alone = "disturbances alone make 0.5, the limit is 0.2"
    told = no_answer(MACHINE, 30.0, ValueError(f"speed 2: {alone}"))
    assert told.endswith(f"leaves nothing to answer it with: speed of Y in m/s: {alone}")
    rest = "length: no response of 8 samples comes to rest"
    assert no_answer(MACHINE, 30.0, NoResponse(rest, {}, {})).endswith(rest)
