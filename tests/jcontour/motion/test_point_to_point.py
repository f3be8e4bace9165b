import numpy as np
import pytest

from jcontour.motion.point_to_point import PointToPoint, ToAndFro, thesis_task_a, thesis_task_b

DT = 1e-3


def test_task_a_is_the_exact_trapezoid():
    time, ramp, cruise = np.clip(np.arange(2202) * DT - 0.1, 0, None), 0.025, 0.975
    stopping = 0.1 - 2 * np.clip(cruise + 2 * ramp - time, 0, None) ** 2
    wanted = np.where(
        time < ramp,
        2 * time**2,
        np.where(time < ramp + cruise, 0.00125 + 0.1 * (time - ramp), stopping),
    )
    task = thesis_task_a()
    assert (task.steps, task.preview, task.dt) == (2201, 1, DT)
    np.testing.assert_allclose(np.asarray(task.position)[:, 0], wanted, rtol=0, atol=1e-15)
    assert np.all(np.asarray(task.position)[:101] == 0) and not np.any(task.start_increment)


def test_task_b_waits_at_the_top_of_its_cosine():
    time = np.arange(3304) * DT
    task = thesis_task_b(preview=3)
    np.testing.assert_allclose(
        np.asarray(task.position)[:, 0],
        0.05 * np.cos(2 * np.clip(time - 0.1, 0, None)) + 0.05,
        rtol=0,
        atol=1e-15,
    )
    assert (task.steps, task.preview) == (3301, 3)


CASES = {
    "cruise": (0.1, 0.1, 4.0, 200.0),
    "short of the feed": (0.02, 1.0, 4.0, 200.0),
    "short of the acceleration": (0.1, 0.1, 40.0, 200.0),
    "short of both": (1e-4, 1.0, 4.0, 200.0),
    "short of both, slow feed": (1e-4, 0.005, 4.0, 100.0),
    "trapezoid": (0.1, 0.1, 4.0, np.inf),
    "triangle": (0.001, 0.1, 4.0, np.inf),
}


@pytest.mark.parametrize("limits", CASES.values(), ids=CASES)
def test_it_arrives_at_rest_within_its_limits_and_uses_one_of_them_all_the_time(limits):
    distance, feed, acceleration, jerk = limits
    law = PointToPoint(*limits)
    time = np.linspace(0, law.duration, 40001)
    h = time[1]
    arc = law(time)
    speed, a = np.gradient(arc, h), np.diff(arc, 2) / h**2
    assert arc[0] == 0 and arc[-1] == distance == law(np.array([2 * law.duration]))[0]
    np.testing.assert_allclose(arc + arc[::-1], distance, rtol=1e-12)  # symmetric
    assert (
        np.all(np.diff(arc) >= 0)
        and speed.max() <= feed * (1 + 1e-9)
        and np.abs(a).max() <= acceleration * (1 + 1e-4)
    )
    used = (speed[1:-1] > 0.999 * feed) | (np.abs(a) > 0.999 * acceleration)
    if np.isfinite(jerk):
        j = np.diff(arc[::100], 3) / (100 * h) ** 3
        assert np.abs(j).max() <= jerk * 1.001
        used = used[150::100][: j.size] | (np.abs(j) > 0.999 * jerk)[: used[150::100].size]
    assert used.mean() > 0.95  # no quicker one exists


def test_s_curve_by_hand():
    """A move of 0.01 m at 0.1 m/s, 2 m/s^2 and 100 m/s^3.

    It has 20 ms of jerk, 30 ms of acceleration and 30 ms of cruise.
    """
    law = PointToPoint(0.01, 0.1, 2.0, 100.0)
    assert law.duration == pytest.approx(0.1 + 0.07)
    assert law(np.array([0.02]))[0] == pytest.approx(100 * 0.02**3 / 6)
    assert law(np.array([0.085]))[0] == pytest.approx(0.005)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: PointToPoint(0.0, 1.0, 1.0), "distance"),
        (lambda: PointToPoint(1.0, np.inf, 1.0), "feed"),
        (lambda: PointToPoint(1.0, 1.0, -1.0), "acceleration"),
        (lambda: PointToPoint(1.0, 1.0, 1.0, 0.0), "jerk"),
        (lambda: ToAndFro(1.0, np.nan), "frequency"),
        (lambda: thesis_task_a(3e-4), "duration"),
    ],
)
def test_bad_limits_are_named(make, name):
    with pytest.raises(ValueError, match=f"^{name}: "):
        make()
