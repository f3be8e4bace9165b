"""An integrator under a gain that is larger on a few samples, which a search may not look at.

z + g - 1 = 0 with g = k b, b the bump: the radius is |1 - g|, and Ms = 2 / (2 - g) at z = -1.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jcontour.controller import Controller
from jcontour.geometry.contours import line
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.simulation.evaluation import stack_plants, stack_references
from tuning.loops import ProbedLoops
from tuning.objectives import mean_tracking_error, no_limits
from tuning.parameters import Positive
from tuning.problem import Problem

STEPS, STEP = 64, 1e-4  # [m] per sample
HIGH = 2.2  # of the gain on the samples
REFERENCE = along(
    line(np.zeros(1), np.full(1, STEP * STEPS)), STEP * np.arange(STEPS), 1e-3, 0, at_rest=False
)


class Bumped(Controller):
    """u = k b (y_d - x) with b = `high` on some samples and 1 on all others."""

    gain: Any
    high: float = eqx.field(static=True)
    samples: tuple[int, ...] = eqx.field(static=True)
    preview: int = eqx.field(static=True, default=0)

    def prepare(self, reference):
        wanted = reference.position[: reference.steps]
        bump = jnp.isin(jnp.round(wanted / STEP), jnp.asarray(self.samples, float))
        return jnp.where(bump, self.high, 1.0), wanted

    def initial_memory(self, reference):
        return None

    def step(self, memory, plan, measurement):
        bump, wanted = plan
        return None, self.gain * bump * (wanted - measurement)


def problem_of(samples, limits=no_limits, high=HIGH, probes=None):
    """The gain that follows best, with the loops at so many probes where there are any."""
    plants = stack_plants([LinearPlant([[1.0]], [[1.0]], [[1.0]], 1e-3)])
    references = stack_references([REFERENCE])
    loops = None if probes is None else ProbedLoops.of(plants, references, probes)
    return Problem(
        lambda weights: Bumped(weights["gain"], high, samples),
        plants,
        references,
        mean_tracking_error,
        {"gain": Positive()},
        limits,
        loops=loops,
    )
