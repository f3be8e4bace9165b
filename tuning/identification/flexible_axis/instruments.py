"""A driven axis as its instruments see it: counting encoders, mean current of every sample."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jcontour.plant import Plant
from jcontour.plants.flexible_axis.linear_motor import DrivenAxis, DrivenState


class Instruments(NamedTuple):
    """How good they are, encoders of motor and end effector alike.

    Attributes:
        resolution: of the encoders [m] per count.
        encoder_noise: standard deviation before the reading is rounded to counts [m].
        current_noise: standard deviation of every recorded current [A].
    """

    resolution: float = 1e-6
    encoder_noise: float = 3e-7
    current_noise: float = 0.01


class Seen(NamedTuple):
    """The driven axis, and what its instruments remember.

    They are the number of the sample, the motor's reading one sample ago [m], and the mean i_q
    since then [A].
    """

    driven: DrivenState
    sample: Int[Array, ""]
    before: Float[Array, " 1"]
    current: Float[Array, " 1"]


class InstrumentedAxis(Plant):
    """A single driven axis that measures its motor, the speed by the difference of two readings.

    Args:
        driven: sampled at the period of the drive.
        noise: of the readings of motor and end effector (T, 2) [m], before they are rounded; the
            last row holds.
        resolution: [m] per count.
        dt: sample period of the readings [s], whole periods of the drive.
    """

    driven: DrivenAxis
    noise: Float[Array, "T 2"]
    resolution: float = eqx.field(static=True)
    dt: float = eqx.field(static=True)

    def initial_state(self, position, increment) -> Seen:
        """As the axis starts itself."""
        start = self.driven.initial_state(position, increment * self.driven.dt / self.dt)
        return Seen(start, jnp.zeros((), int), position - increment, jnp.zeros_like(position))

    def step(self, state: Seen, control) -> Seen:
        """All periods of the drive in one sample."""
        periods = round(self.dt / self.driven.dt)

        def period(_, carry):
            driven, total = carry
            after = self.driven.step(driven, control)
            return after, total + (driven.current[:, 1] + after.current[:, 1]) / 2

        driven, total = jax.lax.fori_loop(
            0, periods, period, (state.driven, jnp.zeros_like(state.current))
        )
        return Seen(driven, state.sample + 1, self.readings(state)[:1], total / periods)

    def output(self, state: Seen) -> Float[Array, " 1"]:
        """The end effector [m]."""
        return self.driven.output(state.driven)

    def measure(self, state: Seen) -> tuple[Float[Array, " 1"], Float[Array, " 1"]]:
        """Reading of the motor and its speed."""
        motor = self.readings(state)[:1]
        return motor, (motor - state.before) / self.dt

    def readings(self, state: Seen) -> Float[Array, " 2"]:
        """Motor and end effector, in whole counts [m]."""
        positions = jnp.concatenate(
            [self.driven.measure(state.driven)[0], self.driven.output(state.driven)]
        )
        noise = self.noise[jnp.minimum(state.sample, len(self.noise) - 1)]
        return self.resolution * jnp.round((positions + noise) / self.resolution)
