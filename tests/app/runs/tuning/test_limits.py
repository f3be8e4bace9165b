"""Limits of the flags: their units, and what is no limit."""

import numpy as np
import pytest

from jcontour.app.designs.design import Design
from jcontour.app.flags.tuning import Tune
from jcontour.app.machines.built_in import bridgeport_machine
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.runs.tuning.limits import (
    AT_REST,
    LIMITS,
    lag_limit,
    loop_limits,
    named_limits,
    noise_limit,
    ratio_limit,
)
from jcontour.geometry.contours import circle
from jcontour.motion.references import along
from jcontour.simulation.evaluation import stack_references
from tests.app import small_runs
from tests.app.small_runs import partly
from tuning.objectives import COUNT_NOISE


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
    found = lag_limit(bridgeport_machine(), partly(Design, lag=lag), stack_references([reference]))
    assert found["rms_tracking_error"] == pytest.approx(wanted, rel=2e-3)


def test_loops_are_limited_by_their_peak_and_with_more_delay():
    assert loop_limits(Tune(max_sensitivity=2.0)) == {"peak_sensitivity": 2.0}
    asked = loop_limits(Tune(max_sensitivity=None, min_delay_margin=2))
    assert list(asked) == ["late_radius"] and asked["late_radius"] < 1
    with pytest.raises(ValueError, match="max-sensitivity: no loop keeps 1 or less"):
        loop_limits(Tune(max_sensitivity=1.0))
    for more in (-1, 11):
        with pytest.raises(ValueError, match="min-delay-margin: needs 0 to 10 samples"):
            loop_limits(Tune(min_delay_margin=more))


def test_the_noise_of_counts_is_limited_to_a_part_of_the_least_control():
    """With a reserve for a tool at rest; the limit needs a machine that counts and states one."""
    machine = small_runs.machine(MachineLimits(control=np.array([8.0, 9.0])))
    design = partly(Design, fed="outputs")
    found = noise_limit(Tune(max_count_noise=0.02), machine, design)
    assert found == {COUNT_NOISE: pytest.approx(AT_REST * 0.02 * 8.0)}
    assert noise_limit(Tune(max_count_noise=None), machine, design) == {}
    assert noise_limit(Tune(max_count_noise=0.02), small_runs.machine(), design) == {}
    assert noise_limit(Tune(max_count_noise=0.02), machine, partly(Design, fed="state")) == {}
    with pytest.raises(ValueError, match="max-count-noise: a limit needs to be finite and above"):
        noise_limit(Tune(max_count_noise=0.0), machine, design)
