"""Limits of the flags: their units, and what is no limit."""

from types import SimpleNamespace

import numpy as np
import pytest

from experiments.flags.tuning import Tune
from experiments.machines.linear import bridgeport_machine
from experiments.runs.tuning.limits import (
    LIMITS,
    lag_limit,
    loop_limits,
    named_limits,
    ratio_limit,
)
from jcontour.geometry.contours import circle
from jcontour.motion.references import along
from jcontour.simulation.evaluation import stack_references


def test_limits_are_in_si_units():
    flags = Tune(max_peak_contour_error_um=5.0, max_rms_control=2.0)
    assert named_limits(flags) == {
        "peak_contour_error": pytest.approx(5e-6),
        "rms_control": 2.0,
    }
    assert ratio_limit(flags) == {} and ratio_limit(Tune(max_error_ratio=0.9)) == {
        "error_ratio": 0.9
    }


@pytest.mark.parametrize("value", [0.0, -1.0, np.inf, np.nan])
@pytest.mark.parametrize("flag", [*LIMITS, "max_error_ratio"])
def test_what_is_no_limit_is_told_by_its_flag(flag, value):
    of = ratio_limit if flag == "max_error_ratio" else named_limits
    with pytest.raises(ValueError, match=f"^{flag.replace('_', '-')}: a limit needs to be finite"):
        of(Tune(**{flag: value}))


@pytest.mark.parametrize(("lag", "wanted"), [(5.0, 5 * 10e-6), (500.0, np.sqrt(2) * 1e-3 / 2)])
def test_a_tool_that_stands_still_lags_too_far(lag, wanted):
    """Once around a circle from one place of it: the RMS distance to that is sqrt(2) radii."""
    arc = np.linspace(0, 2 * np.pi * 1e-3, 628, endpoint=False)
    reference = along(circle(1e-3), arc, 1e-3, 0, at_rest=False)
    found = lag_limit(bridgeport_machine(), SimpleNamespace(lag=lag), stack_references([reference]))
    assert found["rms_tracking_error"] == pytest.approx(wanted, rel=2e-3)


def test_no_loop_has_a_peak_sensitivity_of_one():
    with pytest.raises(ValueError, match="max-sensitivity: no loop keeps 1 or less"):
        loop_limits(Tune(max_sensitivity=1.0))
