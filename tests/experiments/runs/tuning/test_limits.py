"""Limits of the flags: their units, and what is no limit."""

import numpy as np
import pytest

from experiments.flags.tuning import Tune
from experiments.runs.tuning.limits import LIMITS, loop_limits, named_limits, ratio_limit


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


def test_no_loop_has_a_peak_sensitivity_of_one():
    with pytest.raises(ValueError, match="max-sensitivity: no loop keeps 1 or less"):
        loop_limits(Tune(max_sensitivity=1.0))
