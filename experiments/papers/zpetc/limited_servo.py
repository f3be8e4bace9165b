"""One leg as it is built: a current amplifier with a limit, and friction on the ballscrew.

    v' = clip(k u - p v, -h i(t), h i(t)) - f sign(v),   y' = v
The limit i(t) of each motor is printed in section 2; its time counts from the start of the motion.
The factor h follows from Table 1 (torque constant, lead, inertia). Friction is not printed: f is an
assumption.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jcontour.plant import Plant

FIRST, LATER, CHANGE = 30.0, 7.5, 0.5  # [A], [A], [s] after the start of the motion
PER_AMPERE = 0.17011 * 0.7958e-3 / 2.4434e-4  # [m/s^2 per A], Table 1
SUBSTEP = 1e-4  # [s]


class ServoState(NamedTuple):
    """Length [m], its speed [m/s], and the time since the start [s]."""

    position: Float[Array, "1"]
    speed: Float[Array, "1"]
    time: Float[Array, ""]


class LimitedServo(Plant):
    """A velocity servo k / (s (s + p)) whose motor current is limited, with Coulomb friction.

    Without both it is that of `servo_axes` to a trapezoid of the speed over a substep.

    Args:
        gain: k [m/s^2 per unit of control].
        pole: p [rad/s], by feedback of the speed to the amplifier.
        friction: of the motor at any speed [A].
        dt: sample period [s].
    """

    gain: Float[Array, ""]
    pole: Float[Array, ""]
    friction: Float[Array, ""]
    dt: float = eqx.field(static=True)

    def __init__(self, gain: float, pole: float, friction: float, dt: float):
        self.gain, self.pole = jnp.asarray(gain), jnp.asarray(pole)
        self.friction, self.dt = jnp.asarray(friction), dt

    def initial_state(self, position: Float[Array, "1"], increment: Float[Array, "1"]):
        """State at the start of the motion."""
        return ServoState(position, increment / self.dt, jnp.zeros(()))

    def step(self, state: ServoState, control: Float[Array, "1"]) -> ServoState:
        """Exact where nothing is limited and nothing rubs; but a trapezoid of the speed."""
        count = round(self.dt / SUBSTEP)
        h = self.dt / count
        left = jnp.exp(-self.pole * h)

        def substep(_, state: ServoState) -> ServoState:
            y, v, t = state
            most = PER_AMPERE * jnp.where(t < CHANGE, FIRST, LATER) * h
            asked = (1 - left) * (self.gain * control / self.pole - v)
            free = v + jnp.clip(asked, -most, most)
            after = jnp.sign(free) * jnp.maximum(
                jnp.abs(free) - PER_AMPERE * self.friction * h, 0.0
            )
            return ServoState(y + h * (v + after) / 2, after, t + h)

        return jax.lax.fori_loop(0, count, substep, state)

    def output(self, state: ServoState) -> Float[Array, "1"]:
        """Length of the leg [m]."""
        return state.position
