"""My controller as a notebook: write it, simulate it, draw it, ask for its gradient."""

import equinox as eqx
import jax
import jax.numpy as jnp

from jcontour import contours, feed_laws, references, score, simulate
from jcontour.app import ContourRuns, contour_figure
from jcontour.controller import Controller
from jcontour.plants import Encoders, bridgeport


# %% A proportional position loop with velocity feedforward
class Proportional(Controller):
    """u = gain (y_d - y) + feedforward v_d."""

    gain: float | jax.Array  # [control unit per m]
    feedforward: float | jax.Array  # [control unit per m/s]
    preview: int = eqx.field(static=True, default=1)

    def prepare(self, reference):
        position = reference.position[: reference.steps + 1]
        return position[:-1], jnp.diff(position, axis=0) / reference.dt

    def initial_memory(self, reference):
        return None

    def step(self, memory, plan, measurement):
        position, velocity = plan
        return memory, self.gain * (position - measurement) + self.feedforward * velocity


# %% A run of it; the metrics show themselves
machine, circle = Encoders(bridgeport()), contours.circle(5e-3)
arc = feed_laws.constant_feed(circle, 0.05, machine.dt)
reference = references.along(circle, arc, machine.dt, preview=1, at_rest=False)
rollout = simulate(machine, Proportional(4000.0, 20.0), reference)
score(rollout, reference)

# %% The contour with its error magnified
figure = contour_figure(ContourRuns.of(reference, {"mine": rollout}, name="circle"))
figure


# %% What one unit more of each weight changes
def contour_error(weights):
    run = simulate(machine, Proportional(*weights), reference)
    return score(run, reference).rms_contour_error


slope = jax.grad(contour_error)(jnp.array([4000.0, 20.0]))
print(f"gain {1e6 * slope[0]:.4f} um, feedforward {1e6 * slope[1]:.3f} um")
