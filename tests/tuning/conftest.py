from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controller import Controller
from jcontour.geometry.contours import circle
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.simulation.evaluation import stack_plants, stack_references
from tuning.loops import Looked, Loops
from tuning.objectives import mean_contour_error, no_limits
from tuning.outcome import LoopPeaks
from tuning.parameters import Positive
from tuning.problem import Problem


class Proportional(Controller):
    """u = gains (y_d - x) for integrators; diverges where a gain exceeds 2."""

    gains: Any
    preview: int = eqx.field(static=True, default=0)

    def prepare(self, reference):
        return reference.position[: reference.steps]

    def initial_memory(self, reference):
        return None

    def step(self, memory, plan, measurement):
        return None, self.gains * (plan - measurement)


def build(weights):
    return Proportional(jnp.stack([weights["x"], weights["y"]]))


@pytest.fixture(scope="session")
def proportional_problem():
    """Two gains on two integrators around a circle: (limits, objective) -> Problem.

    It compiles in a second.
    """
    plant = LinearPlant(np.eye(2), np.diag([1.0, 0.7]), np.eye(2), 1e-3)
    plants = stack_plants([plant, LinearPlant(np.eye(2), np.diag([0.9, 0.8]), np.eye(2), 1e-3)])
    references = stack_references(
        [along(circle(1e-3), 1e-4 * np.arange(20), 1e-3, 0, at_rest=False)]
    )

    def problem(limits=no_limits, objective=mean_contour_error, loops=None):
        space = {"x": Positive(), "y": Positive()}
        return Problem(build, plants, references, objective, space, limits, loops=loops)

    return problem


class Gains(Loops):
    """Peaks of gains k on integrators of slope b in closed form, with g = b k, at two probes.

    z + g - 1 = 0;   |S| and |T| have their peaks at z = -1, |T| for g < 1 at z = 1

    Args:
        more: added to every spectral radius.
    """

    more: float = 0.0

    def matrices(self, controller, plants):
        gain = jnp.diagonal(plants.B, axis1=1, axis2=2) * controller.gains[None, :]
        radius = jnp.max(jnp.abs(1 - gain), axis=1)
        stable = (radius < 1)[:, None] & (gain < 2)
        below = jnp.where(stable, 2 - gain, 1.0)
        largest = jnp.max(jnp.where(stable, 2 / below, jnp.inf), axis=1)
        most = jnp.max(jnp.where(stable, jnp.maximum(1.0, gain / below), jnp.inf), axis=1)
        found = (largest, most, radius + self.more)
        return LoopPeaks(*(jnp.stack([peak, peak]) for peak in found))

    def look(self, matrices, slopes):
        return Looked(matrices), Looked(slopes)


@pytest.fixture(scope="session")
def loop_peaks():
    return Gains()


@pytest.fixture(scope="session")
def unstable_loops():
    """Loops that no gain makes stable."""
    return Gains(1.0)
