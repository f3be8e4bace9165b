"""The X-Y table as the commands see it."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.catalogue.choices import design_for
from experiments.flags.loops import Simulate
from experiments.jobs.job import Pace, at_constant_feed
from experiments.machines.from_file import linear_machine
from experiments.machines.linear import bridgeport_machine
from jcontour.geometry.contours import polygon
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.simulation.closed_loop import simulate
from jcontour.simulation.evaluation import member
from jcontour.simulation.metrics import score

CORNERS = 2e-3 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])  # [m]


def test_a_drive_that_takes_a_position_stands_still_where_its_part_begins():
    """Whatever its gain and delay; a gain that acts at rest too would bring a jump of a fifth."""
    model = with_input_delay(
        LinearPlant(np.diag([0.9, 0.8]), np.diag([0.1, 0.2]), np.eye(2), 1e-3), 1
    )
    machine = replace(linear_machine(model, "drives"), gain=0.2, delay=2)
    place = np.array([0.03, -0.05])
    drawn = machine.random_family(1, 0)
    plants = [machine.exact_family()[1], machine.exact_family()[-1], member(drawn, 0)]
    for plant in plants:
        state = plant.initial_state(place, np.zeros(2))
        for _ in range(3):
            state = plant.step(state, place)
        np.testing.assert_allclose(plant.output(state), place, rtol=1e-12)


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
