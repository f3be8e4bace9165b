"""The gradient of a metric, with respect to weights of the controller and to the machine itself."""

import jax
import jax.numpy as jnp

from jcontour import LinearPlant, contours, feed_laws, references, score, simulate
from jcontour.controllers import ContouringLQ, LQWeights
from jcontour.plants import bridgeport

model = bridgeport()
circle = contours.circle(1e-3)  # [m]
arc = feed_laws.constant_feed(circle, 0.05, model.dt)  # 0.05 m/s
reference = references.along(circle, arc, model.dt, preview=10, at_rest=False)


@jax.jit
@jax.value_and_grad
def contour_error(change):
    """RMS contour error [m] where weights and machine are changed by these relative amounts."""
    alpha, beta, gain = 1 + change
    weights = LQWeights(alpha=3.0 * alpha, beta=5.0 * beta, rho=2e-9)
    controller = ContouringLQ(model, weights, preview=10)  # it believes the nominal model
    machine = LinearPlant(model.A, gain * model.B, model.C, model.dt, model.pattern)
    rollout = simulate(machine, controller, reference)
    return score(rollout, reference).rms_contour_error


error, slope = contour_error(jnp.zeros(3))
print(
    f"The contour error is {1e6 * error:.3f} um. One per cent more changes it by "
    f"{1e9 * 0.01 * slope[0]:+.1f} nm for alpha, {1e9 * 0.01 * slope[1]:+.1f} nm for beta "
    f"and {1e9 * 0.01 * slope[2]:+.1f} nm for the gain of the machine."
)
