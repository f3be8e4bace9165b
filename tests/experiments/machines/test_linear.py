"""The X-Y table as the commands see it."""

import numpy as np
import pytest

from experiments.catalogue.choices import design_for
from experiments.jobs.job import Pace, at_constant_feed
from experiments.machines.linear import bridgeport_machine
from experiments.options import Simulate
from jcontour.geometry.contours import polygon
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.metrics import score

CORNERS = 2e-3 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])  # [m]


@pytest.mark.slow
def test_the_error_does_not_depend_on_where_the_part_lies():
    """The same square at the origin and a metre away in X and Y."""
    machine = bridgeport_machine()
    design = design_for(machine, Simulate())
    controller = design.build(design.start)
    pace = Pace(machine, 0.0483, None)  # [m/s] no sample falls on a corner, where rounding decides
    errors = []
    for place in (0.0, 1.0):
        job = at_constant_feed("square", polygon(CORNERS + place), pace)
        reference = job.reference(machine.model.dt, design.preview)
        metrics = score(simulate(machine.nominal(), controller, reference), reference)
        errors.append([float(metrics.rms_contour_error), float(metrics.rms_tracking_error)])
    assert errors[1] == pytest.approx(errors[0], rel=1e-9)
