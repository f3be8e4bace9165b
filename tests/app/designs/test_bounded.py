"""Refusals of a bounded MPC in the names and units of the machine."""

import numpy as np

from jcontour.app.designs.bounded import no_answer
from jcontour.app.machines.machine import MachineLimits
from jcontour.sets.least_peaks import NoResponse
from tests.app import small_runs

LIMITS = MachineLimits(control=np.array([400.0, 300.0]), speed=np.array([0.3, 0.2]))
MACHINE = small_runs.machine(LIMITS, control_unit="V", control_noise=15.0, friction=None)


def test_limits_are_told_with_their_units():
    needed, asked = {"speed 2": 0.534529, "control 1": 812.0}, {"speed 2": 0.16, "control 1": 390.0}
    assert no_answer(MACHINE, 15.0, NoResponse("unread", needed, asked)) == (
        "force: 15 V on every control (5 % of the smallest control limit by default; --force sets "
        "it) leaves nothing to answer it with: speed 2 needs 0.535 m/s, the path leaves 0.16; "
        "control 1 needs 812 V, the path leaves 390"
    )


def test_other_reasons_are_told_as_they_are():
    rest = "length: no response of 8 samples comes to rest"
    told = no_answer(MACHINE, 30.0, NoResponse(rest, {}, {}))
    assert "(10 % of the smallest control limit; --force sets it)" in told and told.endswith(rest)
