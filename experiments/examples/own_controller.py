"""A controller of your own, tuned by gradient on three contours of a machine with encoders."""

import equinox as eqx
import jax
import jax.numpy as jnp

from jcontour import contours, feed_laws, references, stack_plants, stack_references
from jcontour.controller import Controller
from jcontour.plants import Encoders, bridgeport
from tuning import AtMost, Effort, Positive, Problem, tune, worst_contour_error


class Proportional(Controller):
    """u = gain (y_d - y) + feedforward v_d, for positions that are measured."""

    gain: jax.Array  # [control unit per m]
    feedforward: jax.Array  # [control unit per m/s]
    preview: int = eqx.field(static=True, default=1)  # a speed needs the next sample too

    def prepare(self, reference):  # all that depends on the future, for all steps at once
        position = reference.position[: reference.steps + 1]
        return position[:-1], jnp.diff(position, axis=0) / reference.dt

    def initial_memory(self, reference):
        return None

    def step(self, memory, plan, measurement):  # one sample
        position, speed = plan
        return memory, self.gain * (position - measurement) + self.feedforward * speed


def build(weights):
    return Proportional(weights["gain"], weights["feedforward"])


machine = Encoders(bridgeport())
square = contours.polygon([[0.0, 0.0], [2e-3, 0.0], [2e-3, 2e-3], [0.0, 2e-3]])
shapes = [contours.circle(1e-3), square, contours.lemniscate(2e-3)]
runs = []
for shape in shapes:
    arc = feed_laws.constant_feed(shape, 0.05, machine.dt)  # 0.05 m/s
    runs.append(references.along(shape, arc, machine.dt, preview=1, at_rest=False))

space = {"gain": Positive(), "feedforward": Positive()}
start = {"gain": jnp.array(4000.0), "feedforward": jnp.array(20.0)}
plants, limits = stack_plants([machine]), AtMost(rms_increment=0.5)  # of the control, per sample
problem = Problem(build, plants, stack_references(runs), worst_contour_error, space, limits)
tuned = tune(problem, start, Effort(starts=1, scatter=0, steps=30, tolerance=1e-4))

worst_before = float(problem.metrics(start).rms_contour_error.max())
worst_after = float(tuned.outcome.metrics.rms_contour_error.max())
print(
    f"Gain {float(tuned.weights['gain']):.0f} 1/m and feedforward "
    f"{float(tuned.weights['feedforward']):.1f} s/m take the worst RMS contour error of three "
    f"contours from {1e6 * worst_before:.1f} to {1e6 * worst_after:.1f} um."
)
