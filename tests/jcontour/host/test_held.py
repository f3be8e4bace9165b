import numpy as np
import pytest

from jcontour.geometry import contours
from jcontour.host.held import Held, thinned
from jcontour.host.loop import reported_loop
from jcontour.motion.references import along
from jcontour.mpc.contouring import MPCC
from jcontour.plants.xy_table import xy_table

CONTOUR = contours.circle(0.02)


def test_looking_between_the_samples_changes_nothing():
    controller = MPCC(xy_table(0.004), CONTOUR)
    slow = reported_loop(
        xy_table(0.004), controller, along(CONTOUR, np.zeros(50), 0.004, 0, at_rest=True)
    ).rollout
    fast = reported_loop(
        xy_table(0.001),
        Held(controller, 4, 2),
        along(CONTOUR, np.zeros(200), 0.001, 0, at_rest=True),
    ).rollout
    np.testing.assert_allclose(fast.output[::4], slow.output, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fast.control, np.repeat(slow.control, 4, axis=0), rtol=0, atol=1e-9)


def test_thinned_reference_has_every_nth_sample_and_the_preview():
    reference = along(CONTOUR, np.linspace(0.0, 0.05, 22), 0.001, 8, at_rest=False)
    thin = thinned(reference, 4)
    assert thin.steps == 6 and thin.preview == 2 and thin.dt == 0.004
    np.testing.assert_array_equal(thin.position[:7], reference.position[::4][:7])
    np.testing.assert_allclose(thin.start_increment, 4 * np.asarray(reference.start_increment))


def test_every_needs_to_be_a_whole_number():
    with pytest.raises(ValueError, match="every"):
        Held(MPCC(xy_table(0.004), CONTOUR), 0, 2)
