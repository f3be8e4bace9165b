from functools import cache

import jax
import numpy as np

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.wrappers.filters import Shaped, shaped_positions
from jcontour.geometry.contours import line
from jcontour.motion.input_shaping import Shaper, shaped_law, zv, zvd
from jcontour.motion.point_to_point import PointToPoint
from jcontour.motion.references import along, in_time
from jcontour.sensors import motors

DT = 1e-3
LAW = PointToPoint(0.02, 0.1, 4.0)


@cache
def short_task():
    return in_time(line([0.0], [0.02]), LAW, 0.45, DT)


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


def test_it_sees_as_far_as_the_controller_inside_and_starts_like_it():
    shaped = Shaped(thesis_cascade(), zv(87.0))
    assert shaped.preview == thesis_cascade().preview
    np.testing.assert_array_equal(
        shaped.initial_memory(short_task()), thesis_cascade().initial_memory(short_task())
    )
