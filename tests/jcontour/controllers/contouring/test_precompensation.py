import numpy as np
import pytest

from jcontour.controllers.contouring.schemes import Precompensated
from jcontour.simulation.closed_loop import prepared, simulate


@pytest.mark.parametrize("angle", [0.0, 0.6, 2.0])
def test_nothing_is_left_on_a_line_whatever_the_axes(table, angle):
    normal = np.array([-np.sin(angle), np.cos(angle)])
    cascade = table.cascade((18.0, 35.0), 0.3)
    plain, found = (
        table.last_error(table.plant, c, table.on_line(angle))
        for c in (cascade, Precompensated(cascade, 8.0))
    )
    assert abs(normal @ found) < 1e-8 and abs(normal @ plain) >= min(
        1e-4, 0.0 if angle == 0.0 else 1e-4
    )


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("feedforward", [0.0, 0.6])
def test_nothing_is_left_on_a_circle_of_equal_axes(table, clockwise, feedforward):
    reference, cascade = table.on_circle(clockwise), table.cascade(feedforward=feedforward)
    radii = [
        np.linalg.norm(np.asarray(simulate(table.equal, controller, reference).output)[-1])
        for controller in (cascade, Precompensated(cascade, 5.0))
    ]
    assert abs(radii[0] - table.radius) > 1e-5
    assert radii[1] == pytest.approx(table.radius, abs=1e-8)


def test_the_command_feed_falls_inside_of_a_curve(table):
    """The command runs on a circle of radius R - a, at 1 - kappa a of the speed."""
    reference, scheme = table.on_circle(), Precompensated(table.cascade(), 5.0)
    run = simulate(table.equal, scheme, reference)
    offset = np.asarray(run.memory.offset)[1:, None]
    frame = prepared(scheme, reference).frame
    command = (
        np.asarray(reference.position)[: reference.steps - 1]
        + offset * np.asarray(frame.normal)[:-1]
    )
    speed = np.linalg.norm(np.diff(command[-10:], axis=0), axis=1) / table.dt
    np.testing.assert_allclose(speed, table.feed * (1 - offset[-1, 0] / table.radius), rtol=1e-5)
