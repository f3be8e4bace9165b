"""Dry friction on a linear plant, of which a force is known and no more."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.linear.plant import LinearPlant
from jcontour.linear.small_products import small_product
from jcontour.plants.friction import Friction
from jcontour.wrapper import Wrapper

SLOWEST = 2e-4  # [m/s] within which friction turns, at least
SAMPLES = 4.0  # times what it changes the speed in a sample
RESPONSE = 20  # samples of which the quickest counts


class WithDryFriction(Wrapper):
    """A linear plant whose axes feel Coulomb friction.

        x(k+1) = A x + B u - E f,     f = F tanh(v / v_0),     v = C (A - I) x / dt
    E is how a force enters, past a delay of the control; v is the speed of the coming sample. Where
    a drive takes a position, the control is a part of it: v = C ((A - I) x + B u) / dt. The
    friction turns within v_0, four times what F changes the speed in a sample, so that the sampled
    loop of speed and friction is calm; below it the axis creeps where a true one sticks.

    A slide of 10 kg that is pushed with less than its friction hardly moves:

    >>> slide = LinearPlant([[1.0, 1e-3], [0.0, 1.0]], [[5e-8], [1e-4]], [[1.0, 0.0]], dt=1e-3)
    >>> rubbed = with_dry_friction(slide, np.asarray(slide.B), np.array([2.0]))
    >>> state = rubbed.initial_state(jnp.zeros(1), jnp.zeros(1))
    >>> for _ in range(1000):  # a second
    ...     state = rubbed.step(state, jnp.array([1.0]))
    >>> bool(rubbed.output(state)[0] < 0.5e-3)  # [m]
    True
    """

    entry: Float[Array, "n m"]
    speed: Float[Array, "m n"]
    led: Float[Array, "m p"]  # speed by the control
    sharpness: Float[Array, " m"]
    friction: Friction

    def step(self, state, control) -> Float[Array, " n"]:
        """A x + B u - E f."""
        speed = small_product(self.speed, state) + small_product(self.led, control)
        force = jnp.tanh(self.sharpness * speed) * self.friction.dry(speed)
        return self.plant.step(state, control) - small_product(self.entry, force)


def with_dry_friction(
    plant: LinearPlant,
    entry: Float[np.ndarray, "n m"],
    force: Float[np.ndarray, " m"],
) -> WithDryFriction:
    """The plant with friction of every axis.

    Args:
        plant: without friction.
        entry: how a force on each axis enters, of one control unit: B where nothing is late.
        force: of each axis [control unit], at least zero.

    Raises:
        ValueError: a force is negative or not finite.
    """
    A, C = np.asarray(plant.A), np.asarray(plant.C)
    friction = Friction(np.asarray(force), 0.0, 1.0, 0.0)
    speed = (C @ A - C) / plant.dt
    takes_position = np.asarray(plant.holding_control(jnp.ones(len(C)))) != 0.0
    led = C @ np.asarray(plant.B) / plant.dt * takes_position
    responses, state = [np.zeros(speed.shape[0])], np.asarray(entry)
    for _ in range(RESPONSE):
        responses.append(np.diagonal(speed @ state))
        state = A @ state
    quickest = np.abs(np.diff(responses, axis=0)).max(axis=0)
    turning = np.maximum(SLOWEST, SAMPLES * np.asarray(force) * quickest)
    parts = (jnp.asarray(part) for part in (entry, speed, led, 1.0 / turning))
    return WithDryFriction(plant, *parts, friction)
