"""What repetitive control and cancellation of run-out share, on a learner that counts."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jcontour.controller import Controller
from jcontour.controllers.learning.repetitive import ErrorDriven, ErrorDrivenMemory
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate


class SumOfErrors(ErrorDriven):
    """Learns the sum of the errors, and leaves the control alone."""

    controller: Controller
    sensors: Sensors

    def untaught(self, axes: int) -> Any:
        return jnp.zeros(axes)

    def step(self, memory, plan, measurement):
        inner, control = self.controller.step(memory.inner, plan.inner, measurement)
        return ErrorDrivenMemory(memory.learned + self.error(plan, measurement), inner), control


def test_the_wrapped_controller_runs_and_the_errors_are_seen(small_loop):
    plant, controller, reference = small_loop()
    wrapped = SumOfErrors(controller, Sensors((0, 2), (1, 3)))
    run, plain = (simulate(plant, one, reference) for one in (wrapped, controller))
    np.testing.assert_array_equal(run.control, plain.control)
    error = np.asarray(reference.position[: reference.steps] - plain.output)
    np.testing.assert_allclose(run.final_memory.learned, error.sum(axis=0), atol=1e-15)
