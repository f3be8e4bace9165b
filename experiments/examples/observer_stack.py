"""Observers around a state-feedback controller: encoders only, and a load that nobody announced."""

import jax.numpy as jnp
import numpy as np

from jcontour import contours, feed_laws, references, score, simulate
from jcontour.controllers import (
    ContouringLQ,
    FilterObserver,
    LQWeights,
    OffsetFreeObserver,
    RiccatiTerminal,
    kalman_gain,
    offset_free_gain,
)
from jcontour.plants import Disturbed, Encoders, Quantised, bridgeport

model = bridgeport()
circle = contours.circle(1e-3)  # [m]
arc = feed_laws.constant_feed(circle, 0.05, model.dt)  # 0.05 m/s
reference = references.along(circle, arc, model.dt, preview=10, at_rest=False)

# The machine, from the inside out: a load on both controls, encoders, counts of 0.1 um.
load = jnp.array([[0.2, -0.1]])  # [control unit], constant: its last row holds
machine = Quantised(Encoders(Disturbed(model, force=load)), 0.1e-6)

inner = ContouringLQ(model, LQWeights(3.0, 5.0, 2e-9), 10, RiccatiTerminal())
noise, count = 1e-3, 0.1e-6 / 12**0.5  # deviations: of the control, of a count
filtered = FilterObserver(inner, model, kalman_gain(model, noise, count))
gain = offset_free_gain(model, model.C, noise, 1e-3, count)
offset_free = OffsetFreeObserver(inner, model, gain, model.C)

rollouts, errors = {}, {}
for name, controller in {"Kalman filter": filtered, "with load": offset_free}.items():
    rollouts[name] = simulate(machine, controller, reference)
    second_half = (reference.steps // 2, reference.steps)
    errors[name] = float(score(rollouts[name], reference, second_half).rms_tracking_error)
estimate = np.asarray(rollouts["with load"].final_memory.disturbance)
print(
    f"Under the load the RMS tracking error is {1e6 * errors['Kalman filter']:.2f} um, "
    f"and {1e6 * errors['with load']:.2f} um if the observer estimates the load too: "
    f"it finds {estimate[0]:.4f} and {estimate[1]:.4f} control units."
)
