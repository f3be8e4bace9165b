"""Runs of a library's user."""

import numpy as np

from jcontour.app.reports.figures.loops.contour_runs import ContourRuns
from jcontour.app.reports.figures.loops.contours import contour_figure
from jcontour.arrays import placed
from jcontour.geometry.contours import circle
from jcontour.motion.feed_laws import constant_feed
from jcontour.motion.references import along
from jcontour.simulation.closed_loop import Rollout

RADIUS = 0.01


def test_runs_of_a_library_user():
    """A tool on a circle a tenth larger: the contour error is the radial distance."""
    contour = circle(RADIUS)
    arc = constant_feed(contour, 0.1, 1e-3)
    reference = along(contour, arc, 1e-3, 0, at_rest=False)
    output = placed(1.1 * np.asarray(reference.position))
    control = placed(np.zeros(output.shape))
    rollout = Rollout(None, output, None, control, None, None, None)
    runs = ContourRuns.of(reference, {"mine": rollout}, "ring")
    (run,) = runs.runs
    np.testing.assert_allclose(np.linalg.norm(run.contour_error, axis=1), 0.1 * RADIUS, rtol=1e-9)
    assert runs.axes == ("X", "Y") and len(contour_figure(runs).axes) == 1
