"""A tuned controller again, under limits at every sample: where they act, and what they cost."""

import numpy as np

from jcontour import contours, feed_laws, references, simulate
from jcontour.controllers import ContouringLQ, LQWeights
from jcontour.mpc import Limits, TrackingMPC, TrackingWeights
from jcontour.plants import bridgeport
from tuning import verify

model = bridgeport()
square = contours.polygon([[0.0, 0.0], [1e-3, 0.0], [1e-3, 1e-3], [0.0, 1e-3]])  # [m]
arc = feed_laws.constant_feed(square, 0.05, model.dt)  # 0.05 m/s, corners at full speed
reference = references.along(square, arc, model.dt, preview=10, at_rest=False)
weights = LQWeights(alpha=3.0, beta=5.0, rho=2e-9)
tuned = ContouringLQ(model, weights, preview=10)

free = simulate(model, tuned, reference)
largest = float(np.abs(np.diff(free.control, axis=0)).max())  # change of a control per sample
limits = Limits.within(increment=0.5 * largest)

# The same weights in a predictive controller that solves a QP at every sample.
constrained = TrackingMPC(model, TrackingWeights.of(weights), 10, limits)
(gap,) = verify(tuned, constrained, limits, {"square": reference}, {"nominal": model})
within = gap.run.rollout
assert gap.within is not None  # None where a QP had no answer
print(
    f"Half the change of control costs accuracy: the RMS contour error goes from "
    f"{1e6 * gap.without.rms_contour_error:.2f} to {1e6 * gap.within.rms_contour_error:.2f} um. "
    f"The limit acts in {100 * gap.run.report.acting_fraction:.0f} % of the samples."
)
