"""One controller on a family of machines: gains off by a tenth, up to two samples of delay."""

import jax.numpy as jnp

from jcontour import contours, evaluate, feed_laws, references, stack_plants, stack_references
from jcontour.controllers import ContouringLQ, LQWeights
from jcontour.linear import with_input_gains
from jcontour.plants import Delayed, bridgeport

model = bridgeport()
circle, eight = contours.circle(1e-3), contours.lemniscate(2e-3)  # [m]
runs = []
for contour in (circle, eight):
    arc = feed_laws.constant_feed(contour, 0.05, model.dt)  # 0.05 m/s
    runs.append(references.along(contour, arc, model.dt, preview=10, at_rest=False))

# All members have one structure, so that they stack: a delay line of two samples, tapped at
# 0, 1 or 2.
members = []
for gain in (0.9, 1.0, 1.1):
    for delay in (0, 1, 2):
        machine = with_input_gains(model, (gain, gain))
        members.append(Delayed(machine, jnp.asarray(delay), depth=2, inputs=2))
family = stack_plants(members)
nominal = 3  # gain 1.0 without delay

controller = ContouringLQ(model, LQWeights(alpha=1.0, beta=5.0, rho=2e-9), preview=10)
metrics = evaluate(family, controller, stack_references(runs))  # axes (contour, machine)
errors = metrics.rms_contour_error
worst = int(jnp.argmax(errors[0]))
print(
    f"On the circle the RMS contour error is {1e6 * errors[0, nominal]:.2f} um for the nominal "
    f"machine and {1e6 * errors[0, worst]:.2f} um for the worst of {len(members)}, "
    f"which acts {worst % 3} samples late."
)
