"""Controllers and a plant that several test files drive."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from jcontour.controller import Controller
from jcontour.plant import Plant


class OnPositions(Controller):
    """Its plan is the wanted position of every sample; it remembers nothing."""

    preview: int = eqx.field(static=True, default=0, kw_only=True)

    def prepare(self, reference):
        return reference.position[: reference.steps]

    def initial_memory(self, reference):
        return None


class Proportional(OnPositions):
    """u = gains (y_d - x) for integrators; diverges where a gain exceeds 2."""

    gains: Any

    def step(self, memory, plan, measurement):
        return None, self.gains * (plan - measurement)


class Sliding(Plant):
    """Axes of 1 kg under air drag, v' = u - |v| v; the state is a tuple."""

    dt: float = 1e-3

    def initial_state(self, position, increment):
        return position, increment / self.dt

    def step(self, state, control):
        position, speed = state
        speed = speed + self.dt * (control - speed * jnp.abs(speed))
        return position + self.dt * speed, speed

    def output(self, state):
        return state[0]
