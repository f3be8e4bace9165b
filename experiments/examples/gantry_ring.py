"""The gantry around a ring at the left of its beam: contour error, and how far the beam twists."""

import jax.numpy as jnp

from jcontour import contours, feed_laws, references, score, simulate
from jcontour.controllers import Cascade, CascadeGains, OfMotors
from jcontour.plants import Gantry, MotorEncoders, Sensed, thesis_gantry
from jcontour.sensors import motors

dt = 1e-3  # [s]
parameters = thesis_gantry()
# The state is (x, y, theta) with rates. The drives see the positions and speeds of three motors,
# counted from where the tool is at zero.
machine = Sensed(Gantry(parameters, dt), MotorEncoders(parameters))

ring = contours.circle(0.05, centre=(-0.6, 0.0))  # [m] x = 0 is the middle of the beam
arc = feed_laws.trapezoidal(ring, 0.3, dt, acceleration=2.0)  # 0.3 m/s, 2 m/s^2
reference = references.along(ring, arc, dt, preview=1, at_rest=True)

# P-PI on each motor; both drives follow y.
head, beam = parameters.head_mass, parameters.total_mass / 2
mass = jnp.stack([head / parameters.head_constant, beam / parameters.drive_constant])
friction = jnp.stack(
    [
        parameters.head_viscous / parameters.head_constant,
        parameters.drive_viscous / parameters.drive_constant,
    ]
)
to_motors = jnp.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
gains = CascadeGains(
    position=30.0,  # [1/s]
    velocity=to_motors @ (100 * mass),  # 100 rad/s
    integral_time=0.05,  # [s]
    feedforward=1.0,
    inertia=to_motors @ mass,
    viscous=to_motors @ friction,
)
controller = OfMotors(Cascade(gains, motors(3), dt), to_motors)

rollout = simulate(machine, controller, reference)
error = float(score(rollout, reference).rms_contour_error)
twist = float(jnp.abs(rollout.state[:, 2]).max())
print(
    f"The RMS contour error is {1e6 * error:.1f} um, and "
    f"the beam turns by up to {1e6 * twist:.2f} urad."
)
