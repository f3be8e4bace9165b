from functools import cache

import jax
import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.wrappers.shaped import Shaped, shaped_positions
from jcontour.geometry.contours import line
from jcontour.motion.input_shaping import Shaper, shaped_law, zv, zvd
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.references import along, in_time
from jcontour.plants.flexible_axis.axis import AxisParameters
from jcontour.plants.flexible_axis.models import zoh_model
from jcontour.plants.friction import Friction
from jcontour.plants.wrappers.encoders import Sensed
from jcontour.sensors import motors
from jcontour.simulation.closed_loop import simulate

DT = 1e-3
LAW = PointToPoint(0.02, 0.1, 4.0)


@cache
def short_task():
    return in_time(line([0.0], [0.02]), LAW, 0.45, DT)


@cache
def linear_axis():
    friction = Friction(0.0, 0.0, 1.0, 250.9)
    parameters = AxisParameters(39.62, 0.38, 2908.0, 2.1, 79.33, friction, [0.0], [0.0], 0.1)
    return zoh_model(parameters, DT)


@cache
def machine():
    return Sensed(linear_axis(), lambda x: x[:2])


@cache
def thesis_cascade():
    return Cascade(CascadeGains(30.0, 55.67, 0.04), motors(1), DT)


def test_whole_samples_of_delay_are_the_shaped_law():
    shaper = Shaper([0.0, 0.02, 0.035], [0.2, 0.5, 0.3])
    wanted = in_time(line([0.0], [0.02]), shaped_law(LAW, shaper), 0.45, DT)
    np.testing.assert_allclose(
        jax.jit(shaped_positions)(short_task(), shaper), wanted.position, rtol=0, atol=1e-15
    )


def test_a_ramp_is_late_by_the_mean_delay_from_its_first_sample_on():
    ramp = along(line([0.0, 0.0], [0.3, 0.4]), 1e-4 * np.arange(60), DT, 1, at_rest=False)
    shaper = zvd(87.0, 0.05)
    late = float(np.dot(shaper.times, shaper.amplitudes)) / DT
    np.testing.assert_allclose(
        jax.jit(shaped_positions)(ramp, shaper),
        np.asarray(ramp.position) - late * 1e-4 * np.array([0.6, 0.8]),
        rtol=0,
        atol=1e-15,
    )


def flexible_mode():
    """Frequency and damping of the closed loop's least damped mode."""
    error, integrated = (
        np.array([[-30.0, -1.0, 0.0, 0.0]]),
        55.67 * DT / 0.04,
    )  # of the speed; w+ = w + integrated e, u = k_pv e + w+
    A, B = np.asarray(linear_axis().A), np.asarray(linear_axis().B)
    loop = np.block([[A + B @ error * (55.67 + integrated), B], [integrated * error, np.eye(1)]])
    s = np.log(np.linalg.eigvals(loop).astype(complex)) / DT
    s = s[s.imag > 1]
    s = s[np.argmin(-s.real / np.abs(s))]
    return np.abs(s), -s.real / np.abs(s)


def test_a_closed_loop_stops_without_vibration():
    shaper = zv(*flexible_mode())
    plain, shaped = (
        simulate(machine(), controller, short_task())
        for controller in (thesis_cascade(), Shaped(thesis_cascade(), shaper))
    )
    deformation = [
        np.ptp(np.diff(np.asarray(run.state)[380:] @ [1, 0, -1, 0])) for run in (plain, shaped)
    ]
    assert deformation[1] < 0.02 * deformation[0]
    assert shaped.output[-1, 0] == pytest.approx(0.02, abs=2e-3)


def test_it_sees_as_far_as_the_controller_inside_and_starts_like_it():
    shaped = Shaped(thesis_cascade(), zv(87.0))
    assert shaped.preview == thesis_cascade().preview
    np.testing.assert_array_equal(
        shaped.initial_memory(short_task()), thesis_cascade().initial_memory(short_task())
    )
