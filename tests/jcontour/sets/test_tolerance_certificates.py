"""Certificates against reference numbers, by hand, and against a controller that does keep it."""

import numpy as np
import pytest

from jcontour.sets.responses import DisturbedModel
from jcontour.sets.tolerance_certificates import least_tolerance_of_any
from tests.reference_data import numbers_of

THESIS = numbers_of("guarantees/single_axis")


def thesis_case(size, speed):
    """Chapter 4 as printed: augmented axis (4.12), trapezoid of 0.1 m, w at its lower end."""
    A, B, C = (np.array(THESIS[f"{name}_aug"]) for name in "ABC")
    inverse = np.linalg.inv(C)
    model = DisturbedModel.of(C @ A @ inverse, C @ B, C @ np.array([0, size, 0, 0]))
    ramp = 4e-3 * np.arange(26)
    speeds = np.concatenate([ramp[:-1], np.full(975, 0.1), ramp[::-1]])
    reference = np.concatenate([[0.0], 1e-3 * np.cumsum(speeds)])
    names = ["x_m", "v_m", "x_e", "v_e"]
    states = model.state_signals(names, np.eye(4), [0.1, speed, 0.1, speed])
    limited = [*states, *model.control_signals(9.0)]
    (tool,) = model.state_signals(["tool"], [[0, 0, 1, 0]], 1.0)
    acting = -np.ones((len(reference) - 1, 1))
    return least_tolerance_of_any(model, tool, limited, reference, acting, [0.05, 0, 0.05, 0, 0])


@pytest.mark.slow
@pytest.mark.parametrize(("size", "speed"), [(0.005, 0.1), (0.0025, 0.1), (0.005, 0.105)])
def test_the_printed_data_need_more_than_they_allow(size, speed):
    actual = thesis_case(size, speed)
    wanted = THESIS["eps_min_m"][f"({size}, {speed})"]
    assert actual == pytest.approx(wanted, rel=1e-6)
    assert (actual > 4.5e-3) == ((size, speed) == (0.005, 0.1))


@pytest.fixture(scope="module", params=[[5e-6], [3e-6, 2e-6]])
def driven(request):
    """Speed in [-0.1, 0.1] m/s, of which w takes 5 mm/s; the reference wants 0.1 m/s."""
    return DisturbedModel.of([[1.0]], [1e-3], [request.param])


def bound(driven, w, steps=200, most=1.0):
    (position,) = driven.state_signals(["x"], [[1.0]], most)
    room = driven.state_signals(["room"], [[1.0]], [1.0])
    limited = [*room, *driven.control_signals(0.1)]
    acting = np.full((steps, driven.disturbances), w)
    return least_tolerance_of_any(driven, position, limited, 1e-4 * np.arange(steps + 1), acting)


def test_a_drive_that_is_too_slow_falls_behind_by_half_of_what_it_loses(driven):
    """It loses 5 um a sample for 200 samples; it may begin ahead. The last w is not foreseen."""
    assert bound(driven, -1.0) == pytest.approx((200 + 1) * 5e-6 / 2, rel=1e-9)


def test_a_disturbance_that_helps_proves_only_what_one_sample_does(driven):
    assert bound(driven, 1.0) == pytest.approx(5e-6, rel=1e-6)


def test_nothing_within_the_limits_is_said(driven):
    with pytest.raises(ValueError, match="nothing keeps them within a tolerance of 0.0001"):
        bound(driven, -1.0, most=1e-4)


def test_bad_input_is_named(driven):
    (x,) = driven.state_signals(["x"], [[1.0]], 1.0)
    control = driven.control_signals(0.1)
    few = np.zeros((3, driven.disturbances))
    with pytest.raises(ValueError, match=r"disturbance: needs shape \(T, [12]\)"):
        least_tolerance_of_any(driven, x, control, np.zeros(4), np.zeros((3, 4)))
    with pytest.raises(ValueError, match="reference: needs one value more"):
        least_tolerance_of_any(driven, x, control, np.zeros(3), few)
    with pytest.raises(ValueError, match="entries of at most one"):
        least_tolerance_of_any(driven, x, control, np.zeros(4), few + 2)
    with pytest.raises(ValueError, match="the proof needs finite ones"):
        least_tolerance_of_any(driven, x._replace(limit=np.inf), control, np.zeros(4), few)
    with pytest.raises(ValueError, match="limit on every state and on every control"):
        least_tolerance_of_any(driven, x, control, np.zeros(4), few)
