"""Least peaks against deadbeat control, against other policies, and against reference numbers."""

import re

import numpy as np
import pytest

from jcontour.sets.least_peaks import NoResponse, PeakProgram, least_peak
from jcontour.sets.responses import DisturbedModel, brought_to_rest


def signals(model, numbers):
    """The tool's error, and the limited signals of the thesis's axis."""
    unit, bounds = np.eye(4), numbers["bounds"]
    speeds = model.state_signals(["v_m", "v_e"], unit[[1, 3]], bounds["v_error"])
    limited = [*speeds, *model.control_signals(bounds["u_tilde"], "u_tilde")]
    return model.state_signals(["tool"], unit[2]), limited


@pytest.mark.parametrize("previewed", [True, False])
def test_least_tolerance_of_the_thesis_is_the_reference(axis, axis_numbers, previewed):
    model = axis if previewed else axis.with_disturbance(axis_numbers["G"])
    for case in axis_numbers["cases"]:
        if case["previewed"] != previewed or "least_tolerance_m" not in case or case["N"] > 60:
            continue
        actual = least_peak(model, *signals(model, axis_numbers), case["N"])
        assert actual.tolerance == pytest.approx(case["least_tolerance_m"], rel=1e-4)
        (answer,) = model.control_signals()
        assert actual.response.peak(answer) <= axis_numbers["bounds"]["u_tilde"] * (1 + 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("previewed", [True, False])
def test_least_tolerance_of_long_responses(axis, axis_numbers, previewed):
    model = axis if previewed else axis.with_disturbance(axis_numbers["G"])
    (wanted,) = [
        case["least_tolerance_m"]
        for case in axis_numbers["cases"]
        if case["previewed"] == previewed and case["N"] == 80
    ]
    actual = least_peak(model, *signals(model, axis_numbers), 80)
    assert actual.tolerance == pytest.approx(wanted, rel=1e-4)


def test_limits_that_nobody_can_keep_are_named(axis, axis_numbers):
    """The reference calls 40 samples infeasible with the reference's acceleration unknown."""
    model = axis.with_disturbance(axis_numbers["G"])
    small, limited = signals(model, axis_numbers)
    with pytest.raises(NoResponse, match="no response of 40 samples keeps them") as refused:
        least_peak(model, small, limited, 40)
    needed = dict(re.findall(r"(\w+) at most \S+, (\S+) would do", str(refused.value)))
    assert "u_tilde" in needed
    would_do = [
        signal._replace(limit=1.001 * float(needed.get(signal.name, signal.limit)))
        for signal in limited
    ]
    assert least_peak(model, small, would_do, 40).tolerance > 0


def test_the_shortest_response_is_deadbeat(slide):
    """With one control and as many samples as states there is one response: poles at zero."""
    actual = least_peak(slide, slide.state_signals(["x"], [1, 0]), [], 2)
    reach = np.concatenate([slide.B, slide.A @ slide.B], axis=1)
    K = np.array([[0, 1]]) @ np.linalg.inv(reach) @ slide.A @ slide.A  # Ackermann
    closed = slide.A - slide.B @ K
    by_hand = sum(abs((np.linalg.matrix_power(closed, j) @ slide.E)[0, 0]) for j in range(2))
    assert actual.tolerance == pytest.approx(by_hand, rel=1e-9)


def test_no_other_policy_is_better_and_longer_ones_are_not_worse(slide):
    small, limited = slide.state_signals(["x"], [1, 0]), slide.control_signals(0.42)
    actual = [least_peak(slide, small, limited, N) for N in (3, 4, 24)]
    assert actual[0].tolerance >= actual[1].tolerance * (1 - 1e-9)
    assert actual[1].tolerance >= actual[2].tolerance * (1 - 1e-9)
    generator, compared = np.random.default_rng(0), 0
    best = actual[2].response.control
    for size in np.geomspace(1e-4, 0.1, 300):
        other = brought_to_rest(slide, 0.999 * best + size * generator.normal(size=best.shape) / 24)
        if other.peak(limited[0]) <= 0.42:
            compared += 1
            assert other.peak(small[0]) >= actual[2].tolerance * (1 - 1e-9)
    assert compared > 20


def test_scale_changes_nothing(slide):
    """Micrometres and metres: the solver's tolerances are absolute, ours are not."""
    tiny = slide._replace(E=1e-9 * slide.E)
    small = slide.state_signals(["x"], [1, 0])
    whole = least_peak(slide, small, slide.control_signals(0.5), 10).tolerance
    part = least_peak(tiny, small, slide.control_signals(0.5e-9), 10).tolerance
    assert part == pytest.approx(1e-9 * whole, rel=1e-8)


def test_units_of_the_states_change_nothing():
    """Two coupled axes, their positions in a unit a thousand times that of the speeds."""
    A = np.block([[np.eye(2), np.eye(2)], [np.zeros((2, 2)), np.eye(2)]])
    B = np.array([[1.0, 0.3], [-0.2, 1.0], [1.0, 0.2], [-0.2, 1.0]])
    E = np.concatenate([B, 1e-6 * np.eye(4)], axis=1)
    actual = []
    for unit in (1.0, 1e-6):
        u = unit * np.array([1e-3, 1e-3, 1.0, 1.0])
        model = DisturbedModel.of(A * u[:, None] / u, B * u[:, None], E * u[:, None])
        x = model.state_signals(["x"], [1, 0, 0, 0])
        actual.append(least_peak(model, x, model.control_signals(1.3), 8).tolerance / u[0])
    assert actual[1] == pytest.approx(actual[0], rel=1e-8)


def test_scales_of_a_response_that_keeps_the_limits_help_the_solver(slide, monkeypatch):
    """The first two scales find nothing: the answer is that of the program solved as ever."""
    small, limits = slide.state_signals(["x"], [1, 0]), slide.control_signals(0.5)
    wanted = least_peak(slide, small, limits, 10).tolerance
    solved, given_up = PeakProgram.solved, []

    def gives_up_twice(self, scales, size, soft=False):
        if not soft and len(given_up) < 2:
            return given_up.append(scales)
        return solved(self, scales, size, soft)

    monkeypatch.setattr(PeakProgram, "solved", gives_up_twice)
    assert least_peak(slide, small, limits, 10).tolerance == pytest.approx(wanted, rel=1e-9)
    assert len(given_up) == 2


def test_a_program_that_the_solver_gives_up_is_said(slide, monkeypatch):
    """No limit is too small, so none can be named: the sizes of the disturbances are."""
    model = slide.with_disturbance(1e-6 * slide.E)
    solved = PeakProgram.solved
    monkeypatch.setattr(
        PeakProgram, "solved", lambda *all, soft=False: solved(*all, soft) if soft else None
    )
    with pytest.raises(NoResponse, match=r"columns of E by a factor of 1e\+06"):
        least_peak(model, model.state_signals(["x"], [1, 0]), model.control_signals(4.0), 8)


def test_a_state_out_of_reach_is_said(slide):
    stuck = slide._replace(B=np.zeros((2, 1)))
    with pytest.raises(NoResponse, match="no response of 5 samples comes to rest"):
        least_peak(stuck, stuck.state_signals(["x"], [1, 0]), stuck.control_signals(1.0), 5)


def test_bad_input_is_named(slide):
    x = slide.state_signals(["x"], [1, 0])
    with pytest.raises(ValueError, match="minimised: needs at least one"):
        least_peak(slide, [], x, 5)
    with pytest.raises(ValueError, match="length: needs at least one sample"):
        least_peak(slide, x, [], 0)
    with pytest.raises(ValueError, match="every name may be there once"):
        least_peak(slide, x, x, 5)
    with pytest.raises(ValueError, match="control: needs a limit above zero"):
        least_peak(slide, x, slide.control_signals(0.0), 5)
    with pytest.raises(ValueError, match="x: needs rows of shape"):
        least_peak(slide, [x[0]._replace(state=np.ones(3))], [], 5)
