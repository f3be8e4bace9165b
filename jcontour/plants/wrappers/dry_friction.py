"""Dry friction on a linear plant, of which a force is known and no more."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.linear.plant import LinearPlant
from jcontour.linear.small_products import small_product
from jcontour.plants.friction import Friction
from jcontour.wrapper import Remembering, Wrapper

SLOWEST = 2e-4  # [m/s] within which friction turns, at least
SAMPLES = 4.0  # times what it changes the speed in a sample
RESPONSE = 20  # samples of which the quickest counts


class WithDryFriction(Wrapper):
    """A linear plant whose axes feel Coulomb friction.

        x(k+1) = A x + B u - E f,     f = F tanh(v / v_0),     v = C (A - I) x / dt
    E is how a force enters, past a delay of the control; v is the speed of the coming sample. The
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
    sharpness: Float[Array, " m"]
    friction: Friction

    def step(self, state, control) -> Float[Array, " n"]:
        """A x + B u - E f."""
        speed = small_product(self.speed, state)
        force = jnp.tanh(self.sharpness * speed) * self.friction.dry(speed)
        return self.plant.step(state, control) - small_product(self.entry, force)


class LostMotion(Remembering):
    """A plant whose drives hold their place against dry friction: commands act through a play.

        w(k) = clip(w(k-1), u(k) - F, u(k) + F)
    A proportional position loop moves while its command is more than F ahead, F being the friction
    over the gains of its loops, and sticks where it is less. The place at rest keeps the reversal
    error, as no friction does that turns smoothly. The plant starts behind the motion.

    Args:
        plant: a machine whose controls are positions.
        force: F of every control [control unit].
    """

    force: Float[Array, " p"]

    def initial_state(self, position, increment) -> tuple:
        """Command that held the plant, behind by the friction where it moves."""
        held = self.plant.holding_control(position) - self.force * jnp.sign(increment)
        return self.plant.initial_state(position, increment), held

    def step(self, state, control) -> tuple:
        """Step of the plant under what comes through the play."""
        acts = jnp.clip(state[1], control - self.force, control + self.force)
        return self.plant.step(state[0], acts), acts


def with_dry_friction(
    plant: LinearPlant,
    entry: Float[np.ndarray, "n m"],
    force: Float[np.ndarray, " m"],
) -> WithDryFriction | LostMotion:
    """The plant with friction of every axis; as lost motion where its drives take positions.

    Args:
        plant: without friction.
        entry: how a force on each axis enters, of one control unit: B where nothing is late.
        force: of each axis [control unit], at least zero.

    Raises:
        ValueError: a force is negative or not finite, or some axes take positions and others none.
    """
    A, C = np.asarray(plant.A), np.asarray(plant.C)
    friction = Friction(np.asarray(force), 0.0, 1.0, 0.0)
    takes_position = np.asarray(plant.holding_control(jnp.ones(len(C)))) != 0.0
    if takes_position.any():
        if not takes_position.all():
            raise ValueError("friction: some axes take positions and others do not")
        return LostMotion(plant, jnp.asarray(force))
    speed = (C @ A - C) / plant.dt
    responses, state = [np.zeros(speed.shape[0])], np.asarray(entry)
    for _ in range(RESPONSE):
        responses.append(np.diagonal(speed @ state))
        state = A @ state
    quickest = np.abs(np.diff(responses, axis=0)).max(axis=0)
    turning = np.maximum(SLOWEST, SAMPLES * np.asarray(force) * quickest)
    parts = (jnp.asarray(part) for part in (entry, speed, 1.0 / turning))
    return WithDryFriction(plant, *parts, friction)
