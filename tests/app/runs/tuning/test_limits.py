"""Limits of the flags: their units, and what is no limit."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.analysis.uncertain_loops import ResponseUncertainty
from jcontour.app.designs.design import Design
from jcontour.app.flags.tuning import Tune
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.linear import bridgeport_machine
from jcontour.app.machines.machine import Machine, MachineLimits
from jcontour.app.runs.tuning.limits import (
    AT_REST,
    FREQUENCIES,
    LIMITS,
    effort_limit,
    family_curves,
    family_peaks,
    held_back,
    lag_limit,
    least_known,
    loop_limits,
    named_limits,
    noise_limit,
    ratio_limit,
)
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import circle, line
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.motion.references import along
from jcontour.plants.encoders import Encoders
from jcontour.simulation.closed_loop import prepared
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


def test_no_effort_is_counted_from_a_start_that_diverges(monkeypatch):
    first = SimpleNamespace(rms_control=np.array([[0.5, 2.0]]))
    monkeypatch.setattr("jcontour.app.runs.tuning.limits.start_metrics", lambda *_: first)
    assert effort_limit(Tune(max_effort=1.2), None, None, {}) == {"rms_control": 2.4}
    first.rms_control[0, 0] = np.nan
    with pytest.raises(ValueError, match="diverges with the first weights"):
        effort_limit(Tune(max_effort=1.2), None, None, {})


@pytest.mark.parametrize(("lag", "wanted"), [(5.0, 5 * 10e-6), (500.0, np.sqrt(2) * 1e-3 / 2)])
def test_a_tool_that_stands_still_lags_too_far(lag, wanted):
    """Once around a circle from one place of it: the RMS distance to that is sqrt(2) radii."""
    arc = np.linspace(0, 2 * np.pi * 1e-3, 628, endpoint=False)
    reference = along(circle(1e-3), arc, 1e-3, 0, at_rest=False)
    bounds = lag_limit(bridgeport_machine(), partly(Design, lag=lag), stack_references([reference]))
    assert bounds["rms_tracking_error"] == pytest.approx(wanted, rel=2e-3)


@pytest.mark.parametrize(("dt", "wanted"), [(4e-3, 5 * 4e-3), (0.5e-3, 2.5e-3), (0.25e-3, 2.5e-3)])
def test_a_machine_that_is_sampled_faster_may_lag_as_long(dt, wanted):
    """By samples of at least half a millisecond: a time at the feed, 10 mm/s here."""
    arc = np.arange(0, 2 * np.pi * 50e-3, 10e-3 * dt)
    reference = along(circle(50e-3), arc, dt, 0, at_rest=False)
    machine = SimpleNamespace(error="contour", model=SimpleNamespace(dt=dt))
    bounds = lag_limit(machine, partly(Design, lag=5.0), stack_references([reference]))
    assert bounds["rms_tracking_error"] == pytest.approx(10e-3 * wanted, rel=1e-4)


def test_where_friction_holds_axes_back_half_of_the_error_of_the_start_is_enough(monkeypatch):
    late = SimpleNamespace(rms_tracking_error=np.array([[1e-4, 8e-4]]))
    monkeypatch.setattr("jcontour.app.runs.tuning.limits.start_metrics", lambda *_: late)
    table = bridgeport_machine()
    rubbed = replace(table, friction=1.0)
    assert held_back(table, None, {}) == 0.0 and held_back(rubbed, None, {}) == 8e-4
    arc = np.linspace(0, 2 * np.pi * 5e-3, 3140, endpoint=False)
    contour = stack_references([along(circle(5e-3), arc, 1e-3, 0, at_rest=False)])
    bounds = lag_limit(rubbed, partly(Design, lag=5.0), contour, held_back(rubbed, None, {}))
    assert bounds["rms_tracking_error"] == pytest.approx(4e-4)  # 5 samples of 10 um are less
    late.rms_tracking_error[0, 0] = np.inf
    assert held_back(rubbed, None, {}) == 0.0


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
    bounds = noise_limit(Tune(max_count_noise=0.02), machine, design)
    assert bounds == {COUNT_NOISE: pytest.approx(AT_REST * 0.02 * 8.0)}
    assert noise_limit(Tune(max_count_noise=None), machine, design) == {}
    assert noise_limit(Tune(max_count_noise=0.02), small_runs.machine(), design) == {}
    assert noise_limit(Tune(max_count_noise=0.02), machine, partly(Design, fed="state")) == {}
    with pytest.raises(ValueError, match="max-count-noise: a limit needs to be finite and above"):
        noise_limit(Tune(max_count_noise=0.0), machine, design)


DT = 1e-3
SHOWN = 0.3  # [rad per sample]: nothing is known of what is above
HIDDEN = ResponseUncertainty(
    np.array([1e-3, SHOWN, SHOWN * 1.0001, np.pi]), np.array([[0.1], [0.1], [5], [5]])
)


def integrator(gain):
    one, nothing = np.eye(1), placed(np.zeros((1, 1)))
    return LinearPlant(one, gain * one, one, DT, motion=SteadyMotion(nothing, nothing))


@pytest.fixture(scope="module")
def loops():
    path = along(line([0.0], [1e-2]), 1e-5 * np.arange(20), DT, 4, at_rest=False)
    law = ContouringLQ(integrator(1.0), LQWeights(1.0, 0.0, 1.0), 4)
    gain = float(np.asarray(prepared(law, path).F)[0, 0, 0])
    family = [Encoders(integrator(size)) for size in (1.0, 0.5, 2.5 / gain)]
    known = {"model": family[0].plant, "measured": ()}
    machine = partly(Machine, smooth_family=lambda fed: family, response_uncertainty=None, **known)
    scenarios = Scenarios((), (True,), (), stack_references([path]), family[0])  # type: ignore
    tried = law, machine, scenarios, "state"
    peaks = family_peaks(*tried)  # type: ignore[arg-type]
    doubted = partly(
        Machine, smooth_family=lambda fed: family[:2], response_uncertainty=HIDDEN, **known
    )
    least = least_known(law, doubted, scenarios, "state")  # type: ignore[arg-type]
    return gain, family_curves(*tried, peaks), peaks, least  # type: ignore[arg-type]


def test_curves_are_closed_forms(loops):
    gain, curves, *_ = loops
    np.testing.assert_allclose(curves.frequency[-1], 0.5 / DT)
    z = np.exp(1j * FREQUENCIES)
    for k, size in enumerate((1.0, 0.5)):
        wanted = np.abs((1 - 1 / z) / (1 - (1 - size * gain) / z))
        np.testing.assert_allclose(curves.sensitivity[k], wanted, rtol=1e-9)
    assert np.isnan(curves.sensitivity[2]).all()  # g = 2.5


def test_peaks_are_closed_forms(loops):
    gain, _, peaks, _ = loops
    assert peaks.sensitivity.shape == (8, 3)
    np.testing.assert_allclose(peaks.sensitivity[0, :2], [2 / (2 - gain), 2 / (2 - gain / 2)])
    assert np.isinf(peaks.sensitivity[:, 2]).all()


def test_a_loop_rests_most_on_the_first_frequency_that_no_record_shows(loops):
    """|T| = g / |exp(j w) - (1 - g)| falls with the frequency; W is five from there on."""
    gain, _, _, least = loops
    assert least.hertz == pytest.approx(SHOWN / (2 * np.pi * DT), rel=1e-3)
    wanted = gain / np.abs(np.exp(1j * SHOWN) - (1 - gain))
    assert least.relative == 5.0 and least.complementary == pytest.approx(wanted, rel=1e-3)
