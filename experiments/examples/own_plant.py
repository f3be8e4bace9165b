"""A machine of your own: two carriages that air drag slows, under a proportional controller."""

import equinox as eqx
import jax.numpy as jnp

from jcontour import contours, feed_laws, references, score, simulate
from jcontour.controllers import Cascade, CascadeGains
from jcontour.plant import Plant
from jcontour.sensors import motors


class DraggedTable(Plant):
    """m v' = F - drag |v| v on every axis; the state is (position [m], speed [m/s])."""

    mass: float  # [kg]
    drag: float  # [N s^2/m^2]
    dt: float = eqx.field(static=True)  # [s] static: a number that shapes the program
    substeps: int = eqx.field(static=True, default=10)

    def initial_state(self, position, increment):
        return position, increment / self.dt  # in steady motion through `position`

    def step(self, state, control):
        position, speed = state
        h = self.dt / self.substeps
        for _ in range(self.substeps):  # semi-implicit Euler
            speed = speed + h * (control - self.drag * jnp.abs(speed) * speed) / self.mass
            position = position + h * speed
        return position, speed

    def output(self, state):
        return state[0]  # the tool; `measure` is the whole state if you do not write it


table = DraggedTable(mass=5.0, drag=400.0, dt=1e-3)
# Position loop 40 1/s around a velocity loop: 500 N per m/s, that is 100 rad/s on 5 kg.
gains = CascadeGains(position=40.0, velocity=500.0, integral_time=0.05)
controller = Cascade(gains, motors(2), table.dt)

feed = 0.1  # [m/s]
way = contours.line([0.0, 0.0], [0.1, 0.0])
ring = contours.circle(0.02)
lags, errors = {}, {}
for name, contour in {"line": way, "circle": ring}.items():
    arc = feed_laws.constant_feed(contour, feed, table.dt)
    reference = references.along(contour, arc, table.dt, controller.preview, at_rest=False)
    rollout = simulate(table, controller, reference)
    lag = reference.position[reference.steps - 1] - rollout.output[-1]
    lags[name] = float(jnp.linalg.norm(lag))
    errors[name] = float(score(rollout, reference).rms_contour_error)

print(
    f"At {feed} m/s the tool ends {1e3 * lags['line']:.2f} mm behind on a line; "
    f"on the circle its RMS contour error is {1e6 * errors['circle']:.0f} um."
)
