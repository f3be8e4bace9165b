"""The gantry with an emulated head: a motor bench moves as x_h (Yuan, section 5.6).

The computer simulates y_N and theta. At every sample it sends the bench i_x and a load current that
makes the bench behave like the head,

    k_A i_T = M_A ((k_A / M_A - k_x / M_e) i_x - (b_A / M_A - b_x / M_e) x_h' - d_x)       (5.46)
Both act `delay` samples later and are held. (5.8), (5.9) go on with the bench's x_h, x_h', x_h''
and with i_1, i_2 at once. If nothing were late and the load were continuous, the bench would be the
head but for its dry friction,

    x_h'' = k_x / M_e i_x - b_x / M_e x_h' + d_x - F_fn / M_A                              (5.47)
d_x is taken at the measured state under the currents being sent. Held and late, it is more than a
disturbance: its term -d theta'' closes a loop through the beam. See `twist_damping`.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jcontour.plant import Plant
from jcontour.plants.friction import caught
from jcontour.plants.gantry.disturbances import disturbances
from jcontour.plants.gantry.gantry import EquationOfMotion, Gantry
from jcontour.plants.gantry.motor_bench.back_to_back_motors import BackToBackMotors, Shaft
from jcontour.plants.integrators import runge_kutta


class Emulated(NamedTuple):
    """State of the gantry, of the bench, and of the line to the bench."""

    gantry: Float[Array, "6"]
    mode: Int[Array, "1"]  # whether the bench sticks (0) or slips (-1, 1)
    sent: Float[Array, "delay 2"]  # i_x and i_T on their way to the bench [A], the last first


class HardwareInLoop(Plant):
    """A `Gantry` whose head is a bench, measured like the gantry.

    It has no useful derivative where the bench sticks: tune on the gantry.

    Args:
        gantry: the emulated machine; its sample period is that of the communication.
        bench: the motors that move as its head.
        delay: samples after which both currents of the bench act; the thesis found one.

    Raises:
        ValueError: the delay is not a whole number, at least zero.
    """

    gantry: Gantry
    bench: BackToBackMotors
    delay: int = eqx.field(static=True)

    def __init__(
        self,
        gantry: Gantry,
        bench: BackToBackMotors,
        delay: int | float = 1,  # section 5.6.2
    ):
        if not (delay >= 0 and delay == int(delay)):
            raise ValueError(
                f"delay: needs a whole number of samples, at least zero, received {delay}"
            )
        self.gantry, self.bench, self.delay = gantry, bench, int(delay)

    @property
    def dt(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Sample period [s]."""
        return self.gantry.dt

    @property
    def alike_everywhere(self) -> bool | tuple[bool, ...]:
        """As the gantry is."""
        return self.gantry.alike_everywhere

    def initial_state(self, position, increment) -> Emulated:
        """State of the gantry, and a line that carries the load of a head without current.

        Raises:
            ValueError: the head would be outside the beam.
        """
        state = self.gantry.initial_state(position, increment)
        before = self._sent(state, jnp.zeros(3))
        mode = jnp.sign(state[3:4]).astype(jnp.int32)
        return Emulated(state, mode, jnp.tile(before, (self.delay, 1)))

    def load_current(self, state: Float[Array, "6"], control: Float[Array, "3"]) -> Shaft:
        """Load current i_T [A] for a state under currents (i_x, i_1, i_2), eq. 5.46."""
        p, bench = self.gantry.parameters, self.bench
        M_A, b_A, k_A = bench.reduced_inertia, bench.reduced_viscous, bench.torque_constant
        d_x = disturbances(p, 0.0, state, control)[0]  # the same for every point of linearisation
        too_strong = k_A / M_A - p.head_constant / p.head_mass
        too_viscous = b_A / M_A - p.head_viscous / p.head_mass
        return M_A / k_A * (too_strong * control[0] - too_viscous * state[3] - d_x)

    def step(self, state: Emulated, control) -> Emulated:
        """State after the substeps of one sample, with the mode of the bench frozen in each."""
        bench, motion = self.bench, EquationOfMotion.of(self.gantry.parameters)
        line = jnp.concatenate([self._sent(state.gantry, control)[None], state.sent])
        driven, loaded = line[self.delay]
        torque = bench.torque_constant * (driven - loaded)

        def substep(_, carry):
            x, mode = carry

            def rates(x):
                along = bench.acceleration(mode, x[3:4], torque)[0]
                beam = motion.beam_acceleration(x[:3], x[3:], control, along)
                return jnp.stack([*x[3:], along, *beam])

            x = runge_kutta(rates, x, self.dt / self.gantry.substeps)
            # the bench turns about without a stop where the torque is enough
            mode = bench.friction.released(caught(mode, x[3:4]), torque)
            return x.at[3:4].set(jnp.where(mode == 0, 0, x[3:4])), mode

        start = state.gantry, bench.friction.released(state.mode, torque)
        x, mode = jax.lax.fori_loop(0, self.gantry.substeps, substep, start)
        return Emulated(x, mode, line[: self.delay])

    def output(self, state: Emulated) -> Float[Array, "2"]:
        """The tool [m]."""
        return self.gantry.output(state.gantry)

    def measure(self, state: Emulated) -> Float[Array, "6"]:
        """Whole state of the gantry."""
        return self.gantry.measure(state.gantry)

    def _sent(self, state, control) -> Float[Array, "2"]:
        return jnp.stack([control[0], self.load_current(state, control)[0]])
