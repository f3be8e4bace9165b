import numpy as np

from tuning.identification.flexible_axis.records import Record
from tuning.identification.flexible_axis.slides import SLOWEST, slides

DT = 1e-3


def parabola(tool=True, dt=DT):
    """1 s with a = 0.4 m/s^2 from -0.2 to 0.2 m/s.

    The end effector has 0.5 m/s^2 more. The current is a ramp.
    """
    time = dt * np.arange(round(1 / dt) + 1)
    motor = -0.2 * time + 0.2 * time**2
    return Record("ramp", dt, motor, 3.0 * time, motor + 0.25 * time**2 if tool else None)


def test_windows_over_a_parabola():
    """Means of a polynomial under a symmetric window are known in closed form."""
    found = list(slides(parabola()))
    assert [one.direction for one in found] == [-1.0, 1.0] and {one.record for one in found} == {
        "ramp"
    }
    for one in found:
        np.testing.assert_allclose(one.inertia, 0.4, rtol=1e-8)
        np.testing.assert_allclose(one.whip, 0.5, rtol=1e-8)
        np.testing.assert_allclose(one.drag, -0.2 + 0.4 * one.time, atol=1e-12)
        np.testing.assert_allclose(one.current, 3.0 * one.time, atol=1e-12 + 3 * DT / 2)
        np.testing.assert_allclose(one.speed @ one.weights, one.drag, atol=1e-12)
        assert np.all(one.direction * one.speed > SLOWEST) and one.weights.sum() == 1.0
        np.testing.assert_allclose(
            one.position[:, 30], -0.2 * one.time + 0.2 * one.time**2, atol=1e-12
        )


def test_current_acts_from_row_to_row():
    """A current held from row k to k + 1 acts half a row later than its time stamp."""
    one = next(slides(parabola()))
    np.testing.assert_allclose(one.current, 3.0 * (one.time - DT / 2), atol=1e-12)


def test_same_windows_at_another_rate():
    coarse, fine = (next(slides(parabola(dt=dt))) for dt in (2e-3, 5e-4))
    assert len(coarse.weights) == 31 and len(fine.weights) == 121
    np.testing.assert_allclose(coarse.inertia.mean(), fine.inertia.mean(), rtol=1e-7)


def test_without_end_effector_and_without_motion():
    assert next(slides(parabola(tool=False))).whip is None
    still = Record("still", DT, np.zeros(1000), np.ones(1000))
    assert not list(slides(still)) and not list(slides(still._replace(motor=np.zeros(20))))
