import numpy as np
import pytest

from jcontour.controllers.contouring.schemes import TaskFrame
from jcontour.geometry.contours import spline
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import simulate

ALONG, ACROSS = 20.0, 45.0


def test_a_turned_path_turns_the_run_of_equal_axes(table):
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    points = 0.01 * np.array([[0.0, 0.0], [1.0, 1.5], [3.0, -0.5], [4.5, 1.0]])
    outputs = []
    for path in (points, points @ turn.T):
        reference = along(
            spline(path), table.feed * table.dt * np.arange(800), table.dt, 1, at_rest=False
        )
        outputs.append(
            np.asarray(
                simulate(
                    table.equal, TaskFrame(table.cascade((ALONG, ACROSS), 0.4)), reference
                ).output
            )
        )
    np.testing.assert_allclose(outputs[1], outputs[0] @ turn.T, rtol=0, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.6, 2.0])
def test_steady_error_on_a_line_is_lag_alone(table, angle):
    """k_along (t'e) = v and n'e = 0 for any axes: the velocity loops integrate."""
    tangent = np.array([np.cos(angle), np.sin(angle)])
    error = table.last_error(
        table.plant, TaskFrame(table.cascade((ALONG, ACROSS))), table.on_line(angle)
    )
    np.testing.assert_allclose(error, table.feed / ALONG * tangent, rtol=0, atol=1e-9)
